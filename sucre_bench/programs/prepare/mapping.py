"""From gray pictures to cameras, poses and sparse points: SIFT, matching and incremental mapping, by pycolmap.

There are two attempts. The usual one suits most dives. If it leaves photos out, the faint one uses larger pictures,
features of lower contrast, and fewer matches. The better result counts.
Schoenberger & Frahm, Structure-from-Motion Revisited, CVPR 2016.
"""

import itertools
import json
import shutil
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

from sucre_bench.errors import InputError
from sucre_bench.machine import processes
from sucre_bench.machine.compute import usable_cores
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.progress import line, say, track
from sucre_bench.programs.prepare.options import CameraModel, Cameras, Matching
from sucre_bench.programs.prepare.photos import Photo, write_gray
from sucre_bench.programs.prepare.registered_photos import load_pycolmap

_MOST_EXHAUSTIVE = 80  # photos: 3,160 pairs, about ten minutes on two cores
_NEIGHBOURS = 10
_ENOUGH = 0.9  # share of the photos placed from which no second attempt follows
_GUIDED_PAIRS = 10  # guided matching finds three times the matches in faint water, at about ten seconds a pair
_RECORD = "model.json"
# COLMAP ends the process where it cannot write or allocate.
_REMEDY = "see that the disk has room and the memory suffices (--max-size), and repeat the command"
PAIRS_A_STEP = 64  # of the progress bar; a command that is stopped loses no more than a step


@dataclass(frozen=True, slots=True)
class Rules:
    """matching: which pairs; camera: COLMAP's model; cameras: which photos share one."""

    matching: Matching
    camera: CameraModel
    cameras: Cameras


@dataclass(frozen=True, slots=True)
class _Attempt:
    """Settings of an attempt. peak: least contrast of a feature."""

    name: str
    longest: int
    peak: float
    start_inliers: int
    pose_inliers: int
    guided: bool


_ATTEMPTS = (_Attempt("usual", 1600, 0.02 / 3, 100, 30, False), _Attempt("faint", 3200, 0.004, 30, 12, True))


@dataclass(frozen=True, slots=True)
class Mapped:
    """model: folder of the COLMAP model, its cameras those of the photos as used; registered: output names; attempt:
    the attempt that gave the model; best_matches: for each photo, the most matches with a placed photo (with any photo
    if none is placed), and the name of that photo; damaged: photos that turned out to be damaged, and why; groups:
    sizes of all separate models."""

    model: Path
    registered: tuple[str, ...]
    attempt: str
    best_matches: dict[str, tuple[int, str]]
    damaged: dict[str, str]
    groups: tuple[int, ...]

    def write(self, folder: Path) -> None:
        """Write it into the folder that holds the model; the folder may be moved."""
        values = {**asdict(self), "model": self.model.relative_to(folder).as_posix()}
        write_atomically(folder / _RECORD, json.dumps(values).encode())


def read_mapped(folder: Path) -> Mapped | None:
    """Return what `Mapped.write` stored in a folder; None if there is nothing."""
    file = folder / _RECORD
    if not file.is_file():
        return None
    known: dict[str, Any] = json.loads(file.read_bytes())
    known |= {name: tuple(known[name]) for name in ("registered", "groups")}
    known["best_matches"] = {name: (count, other) for name, (count, other) in known["best_matches"].items()}
    return Mapped(**{**known, "model": folder / known["model"]})


def map_photos(photos: Sequence[Photo], folder: Path, rules: Rules) -> Mapped:
    """Return the best model of the photos. Files go below `folder`; existing ones are used.

    With fewer than two readable photos it registers none. Raises InputError, with the best pair's matches, if no two
    photos can be related.
    """
    best: Mapped | None = None
    for attempt in _ATTEMPTS:
        if best is not None:
            placed = f"{len(best.registered)} of {len(photos) - len(best.damaged)} photos are placed"
            say(f"{placed}; trying again for faint features")
        mapped = processes.call(partial(_attempt, photos, folder / attempt.name, rules, attempt), _REMEDY)
        if best is None or len(mapped.registered) > len(best.registered):
            best = mapped
        readable = len(photos) - len(best.damaged)
        if readable < 2 or len(best.registered) >= _ENOUGH * readable:
            break
    assert best is not None
    if not best.registered and readable >= 2:
        count, pair = max((n, (name, other)) for name, (n, other) in best.best_matches.items())
        got = f"the best pair, {pair[0]} and {pair[1]}, has {count} matches" if count else "no two photos match at all"
        fault = f"no two photos could be related: {got}, at least {_ATTEMPTS[-1].start_inliers} are needed"
        remedy = "take photos that share more than half of what they show, from places well apart"
        raise InputError(f"{photos[0].path.parent}: {fault}; {remedy}, or add more")
    return best


def _attempt(photos: Sequence[Photo], folder: Path, rules: Rules, attempt: _Attempt) -> Mapped:
    before = read_mapped(folder)
    if before is not None:
        return before
    pycolmap = load_pycolmap()
    pycolmap.set_random_seed(0)
    folder.mkdir(parents=True, exist_ok=True)
    damaged = write_gray(photos, folder, attempt.longest)
    photos = [photo for photo in photos if photo.name not in damaged]
    if len(photos) < 2:
        return Mapped(folder, (), attempt.name, {}, damaged, ())
    database = folder / "database.db"
    with processes.step("COLMAP's search for features"):
        _find_features(pycolmap, database, photos, folder, rules, attempt)
    with processes.step("COLMAP's matching"):
        _match(pycolmap, database, photos, folder, rules, attempt)
    with processes.step("COLMAP's reconstruction"):
        models = _map(pycolmap, database, folder, len(photos), attempt)
    model = folder / "model"
    model.mkdir(exist_ok=True)
    names: tuple[str, ...] = ()
    if models:
        _to_photos(models[0], {photo.key: photo for photo in photos})
        names = tuple(sorted(models[0].image(number).name for number in models[0].reg_image_ids()))
        models[0].write_binary(model)
    matches = _best_matches(pycolmap, database, photos, names)
    mapped = Mapped(model, names, attempt.name, matches, damaged, tuple(m.num_reg_images() for m in models))
    mapped.write(folder)
    shutil.rmtree(folder / "gray")
    return mapped


def _find_features(
    pycolmap: Any, database: Path, photos: Sequence[Photo], folder: Path, rules: Rules, attempt: _Attempt
) -> None:
    """Fill the database with photos and cameras, one after the other, and with features, on all processors.

    The first pass only fixes the order: photos get their numbers as they finish, and other numbers give other models.
    Features that an earlier command found stay.
    """
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = rules.camera
    if photos[0].mask is not None:
        reader.mask_path = folder / "masks"
    quick, real = pycolmap.FeatureExtractionOptions(), pycolmap.FeatureExtractionOptions()
    quick.use_gpu, quick.max_image_size, quick.sift.max_num_features = False, 32, 1
    real.use_gpu, real.max_image_size, real.sift.peak_threshold = False, attempt.longest, attempt.peak

    def extract(names: list[str], options: Any) -> None:
        mode, device = pycolmap.CameraMode.SINGLE, pycolmap.Device.cpu
        pycolmap.extract_features(database, folder / "gray", names, mode, reader, options, device)

    groups, listed = _sharing(photos, rules.cameras), folder / "listed"
    if not listed.is_file():
        for old in folder.glob(f"{database.name}*"):
            old.unlink()
        new = reader.existing_camera_id
        for shared in groups:
            reader.existing_camera_id = new
            for photo in shared:
                extract([photo.key], quick)
                reader.existing_camera_id = _camera_of(pycolmap, database, shared[0])
        with pycolmap.Database.open(database) as opened:
            opened.clear_keypoints()
            opened.clear_descriptors()
        listed.touch()
    batch = usable_cores()
    with line("finding features", len(photos)) as step:
        for shared in groups:
            reader.existing_camera_id = _camera_of(pycolmap, database, shared[0])
            for start in range(0, len(shared), batch):
                extract([photo.key for photo in shared[start : start + batch]], real)  # except those that have features
                for _ in shared[start : start + batch]:
                    step()


def _camera_of(pycolmap: Any, database: Path, photo: Photo) -> int:
    with pycolmap.Database.open(database) as opened:
        return int(opened.read_image_with_name(photo.key).camera_id)


def _sharing(photos: Sequence[Photo], cameras: Cameras) -> list[list[Photo]]:
    """The groups of photos that share a camera; photos of different sizes never do."""
    groups = defaultdict(list)
    for photo in photos:
        shared_by = {"single": "", "folder": str(PurePosixPath(photo.output).parent), "image": photo.output}[cameras]
        groups[shared_by, photo.size].append(photo)
    return list(groups.values())


def _match(
    pycolmap: Any, database: Path, photos: Sequence[Photo], folder: Path, rules: Rules, attempt: _Attempt
) -> None:
    names = [photo.key for photo in photos]
    exhaustive = rules.matching == "exhaustive" or (rules.matching == "auto" and len(names) <= _MOST_EXHAUSTIVE)
    pairs = list(itertools.combinations(names, 2)) if exhaustive else list(_sequential(names))
    matching, verification = pycolmap.FeatureMatchingOptions(), pycolmap.TwoViewGeometryOptions()
    matching.use_gpu, matching.guided_matching = False, attempt.guided and len(pairs) <= _GUIDED_PAIRS
    matching.num_threads = 1  # with more, one run in a hundred found other matches
    verification.ransac.random_seed = 0
    listed = pycolmap.ImportedPairingOptions()
    listed.match_list_path = folder / "pairs.txt"
    batches = [pairs[start : start + PAIRS_A_STEP] for start in range(0, len(pairs), PAIRS_A_STEP)]
    for batch in track(batches, "matching"):  # COLMAP skips the pairs that are in the database
        listed.match_list_path.write_text("".join(f"{one} {other}\n" for one, other in batch))
        pycolmap.match_image_pairs(database, matching, listed, verification, pycolmap.Device.cpu)


def _sequential(names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Every photo with the next ten, and with those 16, 32, 64 ... later, to close the loop of a track."""
    steps = [*range(1, _NEIGHBOURS + 1), *(2**power for power in range(4, 20))]
    for start, name in enumerate(names):
        yield from ((name, names[start + step]) for step in steps if start + step < len(names))


def _map(pycolmap: Any, database: Path, folder: Path, count: int, attempt: _Attempt) -> list[Any]:
    """All models, the one with the most photos first."""
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed, options.min_model_size, options.extract_colors = 0, 2, False
    options.num_threads = 1  # with more threads the order of sums, and so the result, differs from run to run
    options.mapper.init_min_num_inliers = attempt.start_inliers
    options.mapper.abs_pose_min_num_inliers = attempt.pose_inliers
    options.ba_global_function_tolerance = 1e-6
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


def _to_photos(model: Any, photos: dict[str, Photo]) -> None:
    """Convert names, cameras and features from the gray pictures to the photos."""
    factors = {}
    for number in model.reg_image_ids():
        image = model.image(number)
        camera, photo = model.camera(image.camera_id), photos[image.name]
        if image.camera_id not in factors:
            factors[image.camera_id] = (photo.size[0] / camera.width, photo.size[1] / camera.height)
            camera.rescale(*photo.size)
        for point in image.points2D:
            point.xy = point.xy * factors[image.camera_id]
        image.name = photo.output


def _best_matches(
    pycolmap: Any, database: Path, photos: Sequence[Photo], placed: Sequence[str]
) -> dict[str, tuple[int, str]]:
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
