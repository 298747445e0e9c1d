"""From gray pictures to cameras, poses and sparse points: SIFT, matching and incremental mapping, by pycolmap.

There are two attempts. The usual one suits most dives. If it leaves photos out, the faint one uses larger pictures,
features of lower contrast, and fewer matches. The better result counts.
Schoenberger & Frahm, Structure-from-Motion Revisited, CVPR 2016.
"""

import itertools
import json
import shutil
from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import numpy as np

from sucre_bench.arrays import evenly
from sucre_bench.errors import InputError
from sucre_bench.loading.colmap_model import Posed, count_points
from sucre_bench.machine import processes
from sucre_bench.machine.compute import usable_cores
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.progress import line, say, track
from sucre_bench.programs.prepare import Options
from sucre_bench.programs.prepare.photos import Photo, write_gray
from sucre_bench.programs.prepare.shots import load_pycolmap, write_model

_MOST_EXHAUSTIVE = 80  # photos: 3,160 pairs, about ten minutes on two cores
# steps: ten neighbours, then to close loops
_SEQUENTIAL = (
    *range(1, 11),
    *(2**power for power in range(4, 20)),
)
_ENOUGH = 0.9  # share of the photos placed from which no second attempt follows
_GUIDED_PAIRS = 10  # guided matching finds three times the matches in faint water, at about ten seconds a pair
# COLMAP ends the process where it cannot write or allocate.
_REMEDY = (
    "see that the disk has room and the memory suffices (--max-size), and repeat the command"
)
# A logo has matches that move less than so many pixels, in the same cells for so large a share of pairs, and in few of
# the 20 x 20 cells of an image. Pairs count if most other matches move farther than 0.05 widths: what is straight
# ahead of a slow camera stands still, too.
_STILL_PX = 1.0
_FAR = 0.05
_CELLS = 20
_OFTEN = 0.5
_LARGEST = 0.1
_PAIRS_LOOKED_AT = 200
# of a pair that is looked at
_FEWEST_MATCHES = 15
# with such matches in a cell
_FEWEST_PAIRS = 3
PAIRS_A_STEP = 64  # of the progress bar; a command that is stopped loses no more than a step


class _Attempt(NamedTuple):
    """Settings of an attempt."""

    name: str
    longest: int

    peak: float
    """Least contrast of a feature."""

    start_inliers: int
    pose_inliers: int
    guided: bool


_ATTEMPTS = (
    _Attempt("usual", 1600, 0.02 / 3, 100, 30, False),
    _Attempt("faint", 3200, 0.004, 30, 12, True),
)


@dataclass(frozen=True, slots=True)
class Mapped:
    """The model that an attempt gave, and what was found out about the photos."""

    model: Path
    """Folder of the COLMAP model, its cameras those of the photos as used."""

    registered: list[str]
    """Output names of the photos that are placed in it."""

    attempt: str
    """The one that gave the model, by name."""

    best_matches: dict[str, tuple[int, str]]
    """For each photo, the most matches with a placed photo (with any photo if none is placed), and the name of that
    photo."""

    damaged: dict[str, str]
    """Photos that turned out to be damaged, and why."""

    groups: list[int]
    """Sizes of all separate models."""

    has_logo: bool = False
    """Whether something stands at one place of all photos."""


def _stored(folder: Path) -> Mapped | None:
    """What an attempt has left in its folder, which may have been moved; None if it has not ended."""
    file = folder / "model.json"
    return (
        Mapped(**json.loads(file.read_bytes()) | {"model": folder / "model"})
        if file.is_file()
        else None
    )


def map_photos(
    photos: Sequence[Photo],
    folder: Path,
    options: Options,
    given: Mapping[str, Posed] | None = None,
) -> Mapped:
    """Return the best model of the photos. Files go below `folder`; existing ones are used.

    given: known cameras, at the photos' sizes, and poses, by the photos' keys: only points are sought, in one attempt.
    With fewer than two readable photos it registers none. Raises InputError, with the best pair's matches, if no two
    photos can be related.
    """
    best: Mapped | None = None
    readable = len(photos)
    for attempt in _ATTEMPTS[:1] if given else _ATTEMPTS:
        mapped = _stored(folder / attempt.name)
        if mapped is None:
            if best is not None:
                say(
                    f"{len(best.registered)} of {readable} photos are placed; trying again for faint features"
                )
            processes.call(
                partial(_attempt, photos, folder / attempt.name, options, attempt, given),
                _REMEDY,
            )
            mapped = _stored(folder / attempt.name)
            assert mapped is not None
        if best is None or len(mapped.registered) > len(best.registered):
            best = mapped
        readable = len(photos) - len(best.damaged)
        if readable < 2 or len(best.registered) >= _ENOUGH * readable:
            break
    assert best is not None
    if not best.registered and readable >= 2:
        count, pair = max((n, (name, other)) for name, (n, other) in best.best_matches.items())
        got = (
            f"the best pair, {pair[0]} and {pair[1]}, has {count} matches"
            if count
            else "no two photos match at all"
        )
        least = _ATTEMPTS[-1].start_inliers
        lack = (
            f"at least {least} are needed"
            if count < least
            else "but its cameras are not apart enough"
        )
        fault = f"no two photos could be related: {got}, {lack}"
        if best.damaged:
            fault += f"; {', '.join(sorted(best.damaged))} cannot be read"
        remedy = "take photos that share more than half of what they show, from places well apart, or add more"
        raise InputError(fault, photos[0].path.parent, remedy)
    return best


def _attempt(
    photos: Sequence[Photo],
    folder: Path,
    options: Options,
    attempt: _Attempt,
    given: Mapping[str, Posed] | None,
) -> None:
    """Leave a model and its record in the folder."""
    pycolmap = load_pycolmap()
    pycolmap.set_random_seed(0)
    folder.mkdir(parents=True, exist_ok=True)
    damaged = write_gray(photos, folder, attempt.longest)
    photos = [photo for photo in photos if photo.name not in damaged]
    model = folder / "model"
    models = []
    has_logo = False
    names: list[str] = []
    matches: dict[str, tuple[int, str]] = {}
    if len(photos) >= 2:
        database = folder / "database.db"
        with processes.step("COLMAP's search for features"):
            _find_features(database, photos, options, attempt)
        posed = _with_cameras(database, given) if given else None
        with processes.step("COLMAP's matching"):
            has_logo = _match(database, [photo.key for photo in photos], options, attempt)
        with processes.step("COLMAP's reconstruction"):
            if posed is None:
                models = _map(database, len(photos), attempt, options.focal is not None)
            else:
                models = [pycolmap.triangulate_points(posed, database, folder / "gray", folder)]
        if models:
            names = _written(models[0], {photo.key: photo for photo in photos}, model)
        matches = _best_matches(database, photos, names)
    mapped = Mapped(
        model,
        names,
        attempt.name,
        matches,
        damaged,
        [m.num_reg_images() for m in models],
        has_logo,
    )
    write_atomically(folder / "model.json", json.dumps(asdict(mapped), default=str).encode())
    shutil.rmtree(folder / "gray", ignore_errors=True)


def _find_features(
    database: Path, photos: Sequence[Photo], options: Options, attempt: _Attempt
) -> None:
    """Fill the database with photos and cameras, in order, and then with features, on all processors.

    Features that an earlier command found stay.
    """
    pycolmap = load_pycolmap()
    folder = database.parent
    reader, extraction = pycolmap.ImageReaderOptions(), pycolmap.FeatureExtractionOptions()
    reader.camera_model = options.camera
    if photos[0].mask is not None:
        reader.mask_path = folder / "masks"
    extraction.use_gpu = False
    extraction.max_image_size = attempt.longest
    extraction.sift.peak_threshold = attempt.peak

    groups = defaultdict(list)  # that share a camera; photos of different sizes never do
    for photo in photos:
        parent = str(PurePosixPath(photo.output).parent)
        by = {"single": "", "folder": parent, "image": photo.output}[options.cameras]
        groups[by, photo.size].append(photo)
    listed = folder / "listed"
    mode = pycolmap.CameraMode.SINGLE
    if not listed.is_file():
        # else photos would be numbered as they finish; other numbers give other models
        for old in folder.glob(f"{database.name}*"):
            old.unlink()
        pycolmap.Database.open(database).close()  # makes the file
        for group in groups.values():
            # The gray pictures have no EXIF. Below water its focal length is no more than a start.
            reader.default_focal_length_factor = options.focal or _exif_focal(group[0].path)
            pycolmap.import_images(
                database, folder / "gray", mode, [photo.key for photo in group], reader
            )
        if options.focal is not None:
            with pycolmap.Database.open(database) as opened:
                for camera in opened.read_all_cameras():
                    camera.has_prior_focal_length = True
                    opened.update_camera(camera)
        listed.touch()
    with line("finding features", len(photos)) as step:
        for group in groups.values():
            for batch in _batches([photo.key for photo in group], usable_cores()):
                # except those that have features
                pycolmap.extract_features(
                    database,
                    folder / "gray",
                    batch,
                    mode,
                    reader,
                    extraction,
                    pycolmap.Device.cpu,
                )
                for _ in batch:
                    step()


def _exif_focal(path: Path) -> float:
    """The focal length that a photo's EXIF tells, in longer sides; without any COLMAP's usual guess."""
    with suppress(ValueError):  # COLMAP cannot read every format
        camera = load_pycolmap().infer_camera_from_image(path)
        return float(camera.mean_focal_length() / max(camera.width, camera.height))
    return 1.2


def _batches(items: Sequence[Any], size: int) -> list[Sequence[Any]]:
    return [items[start : start + size] for start in range(0, len(items), size)]


def _match(database: Path, names: Sequence[str], options: Options, attempt: _Attempt) -> bool:
    """Match pairs of photos: all, or each with those that follow it by certain steps; a logo has no matches.

    Return whether there is a logo.
    """
    pycolmap = load_pycolmap()
    is_long = options.matching == "auto" and len(names) > _MOST_EXHAUSTIVE
    if options.matching == "sequential" or is_long:
        starts = enumerate(names)
        pairs = [
            (name, names[i + step])
            for i, name in starts
            for step in _SEQUENTIAL
            if i + step < len(names)
        ]
    else:
        pairs = list(itertools.combinations(names, 2))
    matching, verification = (
        pycolmap.FeatureMatchingOptions(),
        pycolmap.TwoViewGeometryOptions(),
    )
    matching.use_gpu = False
    matching.guided_matching = attempt.guided and len(pairs) <= _GUIDED_PAIRS
    matching.num_threads = 1  # with more, one run in a hundred found other matches
    verification.ransac.random_seed = 0
    listed = pycolmap.ImportedPairingOptions()
    listed.match_list_path = database.parent / "pairs.txt"
    for batch in track(_batches(pairs, PAIRS_A_STEP), "matching"):
        # COLMAP skips the pairs that are in the database
        listed.match_list_path.write_text("".join(f"{one} {other}\n" for one, other in batch))
        pycolmap.match_image_pairs(
            database, matching, listed, verification, pycolmap.Device.cpu
        )
    with pycolmap.Database.open(database) as opened:
        has_logo = _has_logo(opened, pairs)
        if has_logo:
            say(
                "something stands at one place of all photos, as a logo does; its matches are left out"
            )
            opened.clear_two_view_geometries()
    if has_logo:
        verification.filter_stationary_matches = True
        verification.stationary_matches_max_error = _STILL_PX
        listed.match_list_path.write_text("".join(f"{one} {other}\n" for one, other in pairs))
        pycolmap.verify_matches(database, listed.match_list_path, verification)
    return has_logo


def _has_logo(opened: Any, pairs: Sequence[tuple[str, str]]) -> bool:
    """Whether most pairs in which much else moves have matches that do not move in the same few cells of the images."""
    images = {image.name: image for image in opened.read_all_images()}
    count = 0
    counts = np.zeros((_CELLS, _CELLS))
    for one, other in (pairs[k] for k in evenly(len(pairs), _PAIRS_LOOKED_AT)):
        first, second = images[one], images[other]
        matches = opened.read_matches(first.image_id, second.image_id)
        if len(matches) < _FEWEST_MATCHES:
            continue
        sides = (opened.read_keypoints(image.image_id)[:, :2] for image in (first, second))
        at, there = (places[of] for places, of in zip(sides, matches.T, strict=True))
        camera, motion = opened.read_camera(first.camera_id), np.linalg.norm(at - there, axis=1)
        still = motion < _STILL_PX
        if 2 * np.sum(motion > _FAR * camera.width) <= np.sum(~still):
            continue
        x, y = at[still].T
        in_cell, *_ = np.histogram2d(x, y, _CELLS, [[0, camera.width], [0, camera.height]])
        count, counts = count + 1, counts + (in_cell > 0)
    cells = counts >= max(_FEWEST_PAIRS, _OFTEN * count)
    return bool(0 < cells.mean() <= _LARGEST)


def _map(database: Path, count: int, attempt: _Attempt, is_held: bool) -> list[Any]:
    """All models, the one with the most photos first. count: number of photos; is_held: whether the focal length is."""
    pycolmap = load_pycolmap()
    folder = database.parent
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed, options.min_model_size, options.extract_colors = 0, 2, False
    # with more threads the order of sums, and so the result, differs from run to run
    options.num_threads = 1
    options.mapper.init_min_num_inliers = attempt.start_inliers
    options.mapper.abs_pose_min_num_inliers = attempt.pose_inliers
    options.ba_global_function_tolerance = 1e-6
    options.ba_refine_focal_length = not is_held
    output = folder / "models"
    shutil.rmtree(output, ignore_errors=True)
    output.mkdir()
    in_model = shown = 0  # COLMAP may begin again with other photos, or place one twice

    def placed(number: int) -> None:
        nonlocal in_model, shown
        in_model = number
        for _ in range(shown, min(in_model, count)):
            step()
            shown += 1

    with line("placing photos", count) as step:
        models = pycolmap.incremental_mapping(
            database,
            folder / "gray",
            output,
            options,
            initial_image_pair_callback=lambda: placed(2),
            next_image_callback=lambda: placed(in_model + 1),
        )
    return sorted(models.values(), key=lambda m: (-m.num_reg_images(), -m.num_points3D()))


def _with_cameras(database: Path, given: Mapping[str, Posed]) -> Any:
    """Write the given cameras into the database; return the model of them and the given poses, without points."""
    pycolmap = load_pycolmap()
    model = pycolmap.Reconstruction()
    with pycolmap.Database.open(database) as opened:
        for stored in opened.read_all_images():
            one = given[stored.name]
            found = opened.read_camera(stored.camera_id)
            K, lens = one.camera.K, one.lens
            terms = lens.coefficients if lens is not None else ()
            name, count = (
                ("OPENCV_FISHEYE", 4)
                if lens is not None and lens.model == "fisheye"
                else ("FULL_OPENCV", 8)
            )
            params = [K[0, 0], K[1, 1], K[0, 2], K[1, 2], *terms, *[0.0] * (count - len(terms))]
            size = {"width": one.camera.width, "height": one.camera.height}
            camera = pycolmap.Camera(
                camera_id=found.camera_id, model=name, params=params, **size
            )
            camera.rescale(found.width, found.height)
            opened.update_camera(camera)
            model.add_camera_with_trivial_rig(camera)
            image = pycolmap.Image(
                name=stored.name, camera_id=camera.camera_id, image_id=stored.image_id
            )
            model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(one.cam_from_world[:3]))
    return model


def adopted(sparse: Path, photos: dict[str, Photo], folder: Path, fewest: int) -> Mapped | None:
    """Return a COLMAP model as that of the photos, points included; None if it has few. Files go into `folder`.

    photos: by the names that the model has for them; images without a photo are left out; fewest: points that a photo
    must see on average. Raises InputError if the file of its points breaks off.
    """
    points = sparse / ("points3D.bin" if (sparse / "images.bin").is_file() else "points3D.txt")
    if not points.is_file() or (points.suffix == ".bin" and not count_points(points)):
        # pycolmap hangs on a cut file
        return None
    model = load_pycolmap().Reconstruction(sparse)
    for image in [model.image(number) for number in model.reg_image_ids()]:
        if image.name not in photos:
            model.deregister_frame(image.frame_id)
    if model.num_points3D() == 0 or model.compute_mean_observations_per_reg_image() < fewest:
        return None
    names = _written(model, photos, folder / "model")
    return Mapped(folder / "model", names, "given", {}, {}, [len(names)])


def _written(model: Any, photos: dict[str, Photo], folder: Path) -> list[str]:
    """Convert names, cameras and features of a model to those of the photos, write it, and return the names."""
    factors = {}
    for number in model.reg_image_ids():
        image = model.image(number)
        camera = model.camera(image.camera_id)
        photo = photos[image.name]
        if image.camera_id not in factors:
            factors[image.camera_id] = (
                photo.size[0] / camera.width,
                photo.size[1] / camera.height,
            )
            camera.rescale(*photo.size)
        for point in image.points2D:
            point.xy = point.xy * factors[image.camera_id]
        image.name = photo.output
    write_model(model, folder)
    return sorted(model.image(number).name for number in model.reg_image_ids())


def _best_matches(
    database: Path, photos: Sequence[Photo], placed: Sequence[str]
) -> dict[str, tuple[int, str]]:
    """By photo, the most matches with a placed one (with any if none is placed), and the name of that."""
    pycolmap = load_pycolmap()
    among = {photo.name for photo in photos if not placed or photo.output in placed}
    best = {photo.name: (0, "") for photo in photos}
    name_of = {photo.key: photo.name for photo in photos}
    with pycolmap.Database.open(database) as opened:
        names = {image.image_id: name_of[image.name] for image in opened.read_all_images()}
        pairs, inliers = opened.read_two_view_geometry_num_inliers()
    for pair, count in zip(pairs, inliers, strict=True):
        one, other = (names[number] for number in pycolmap.pair_id_to_image_pair(pair))
        for a, b in ((one, other), (other, one)):
            if b in among:
                best[a] = max(best[a], (count, b))
    return best
