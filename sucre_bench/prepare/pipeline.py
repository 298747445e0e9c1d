"""The stages in order, from a folder of photos to a folder that the colmap dataset reads."""

from __future__ import annotations

import errno
import importlib.metadata
import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

from sucre_bench.errors import InputError, OutputError, SucreBenchError
from sucre_bench.prepare.colmap import load_pycolmap
from sucre_bench.prepare.depthmaps import Dense, DepthMaps, Sparse, write_depth
from sucre_bench.prepare.mapping import Cameras, Mapped, Matching, Rules, map_photos
from sucre_bench.prepare.photos import Photo, find_photos
from sucre_bench.prepare.quality import Quality, quality_of, shown, thumbnails, write_page
from sucre_bench.prepare.relief import relief_of
from sucre_bench.prepare.scale import Known, Scale, find_scale
from sucre_bench.prepare.shots import Shot, read_shots
from sucre_bench.prepare.stages import stage
from sucre_bench.prepare.undistort import undistort
from sucre_bench.progress import say, track
from sucre_bench.results import write_atomically

__all__ = ["Options", "Prepared", "prepare"]

T = TypeVar("T")

_MOST_DENSE = 500  # photos: about an hour of plane sweeps on two cores


@dataclass(frozen=True, slots=True)
class Options:
    """masks: folder, white where a photo is to be used; matching: which pairs of photos, by their count when auto;
    camera: COLMAP's name of the model; cameras: which photos share one; max_size: longest side in pixels that photos
    are shrunk to, 0 for none; surface: plane sweep or relief of the sparse points, by count when auto; depth_size:
    longest side in pixels of swept images."""

    masks: Path | None = None
    matching: Matching = "auto"
    camera: str = "SIMPLE_RADIAL"
    cameras: Cameras = "single"
    max_size: int = 0
    surface: Literal["auto", "dense", "sparse"] = "auto"
    depth_size: int = 800


@dataclass(frozen=True, slots=True)
class Prepared:
    """What came out: the folder, its images' figures, how many photos there were, the scale, and what to beware of."""

    out: Path
    qualities: tuple[Quality, ...]
    photos: int
    scale: Scale
    warnings: tuple[str, ...]


def prepare(
    folder: Path, out: Path, options: Options | None = None, known: Known | None = None, again: bool = False
) -> Prepared:
    """Turn a folder of photos into images, a model and depth maps below `out`; what is done already is kept.

    again: whether `out` may be made anew with other options. Raises InputError where photos or options are of no use,
    OutputError where `out` cannot be written.
    """
    options, known = options or Options(), known or Known()
    work = out / ".prepare"
    _check_folders(folder, out)
    photos, unreadable = find_photos(folder, options.masks, options.max_size, out)
    _check_options(work, folder, options, again)
    for name, why in unreadable.items():
        say(f"left out  {name}: {why}")

    rules = Rules(options.matching, options.camera, options.cameras)
    mapping = stage(work, "model", [photo.stamp for photo in photos], rules)
    mapped = _kept(mapping.folder / "mapped.json", out, lambda: map_photos(photos, mapping.folder, rules))
    unreadable |= mapped.unreadable
    by_output = {photo.output: photo for photo in photos}

    straight = stage(work, "images", mapping.key)
    pinhole, masks = straight.folder / "sparse", straight.folder / "masks"
    if not straight.done:
        _guarded(out, lambda: undistort(by_output, mapped.model, out / "images", masks, pinhole))
        straight.finish()
    shots = read_shots(pinhole)

    maps = _depth_maps(work, straight.key, shots, out / "images", masks, options)
    output_of = {photo.name: photo.output for photo in photos}
    placed = {shot.name: shot for shot in shots}
    scale = find_scale(known, shots, output_of, lambda name: maps.depth(placed[name]))

    left_out = [*unreadable.items(), *_unplaced(photos, mapped)]
    warnings = _warnings(photos, mapped, scale)
    qualities = _guarded(
        out, lambda: _write(out, pinhole, shots, maps, scale, folder, left_out, warnings, mapped, options)
    )
    return Prepared(out, qualities, len(photos) + len(set(unreadable) - set(output_of)), scale, tuple(warnings))


def _check_folders(folder: Path, out: Path) -> None:
    if out.exists() and not out.is_dir():
        raise OutputError(f"{out}: is a file; name a folder to write into")
    if folder.resolve() == out.resolve() or out.resolve() in folder.resolve().parents:
        raise InputError(f"{out}: holds the photos themselves; name another folder to write into")
    if out.is_dir() and any(out.iterdir()) and not (out / ".prepare").is_dir():
        raise InputError(f"{out}: holds other files already; name a new folder")


def _check_options(work: Path, folder: Path, options: Options, again: bool) -> None:
    """Refuse to overwrite by accident what was made otherwise; a scale may always be changed."""
    asked = {"photos": str(folder.resolve()), **{k: str(v) for k, v in asdict(options).items()}}
    file = work / "options.json"
    if file.is_file() and not again:
        before = json.loads(file.read_text())
        for name, value in asked.items():
            if before.get(name) != value:
                was = f"was prepared with {name}={before.get(name)}, not {value}"
                raise InputError(f"{work.parent}: {was}; name another folder, or add --again to make it anew")
    if not file.is_file() or json.loads(file.read_text()) != asked:
        for name in ("images", "depths", "sparse"):
            shutil.rmtree(work.parent / name, ignore_errors=True)
        for old in work.glob("images-*"):
            shutil.rmtree(old)
    write_atomically(file, json.dumps(asked, indent=1).encode())


def _kept(file: Path, out: Path, make: Callable[[], Mapped]) -> Mapped:
    if file.is_file():
        known: dict[str, Any] = json.loads(file.read_text())
        known["model"] = Path(known["model"])
        known |= {name: tuple(known[name]) for name in ("registered", "groups")}
        return Mapped(**known)
    made = _guarded(out, make)
    for name in ("images", "depths"):  # of another model
        shutil.rmtree(out / name, ignore_errors=True)
    write_atomically(file, json.dumps(asdict(made), default=str).encode())
    return made


def _guarded(out: Path, do: Callable[[], T]) -> T:
    """Tell a full disk from a fault: the libraries that write say neither clearly."""
    try:
        return do()
    except SucreBenchError:
        raise
    except Exception as fault:
        full = isinstance(fault, OSError) and fault.errno in (errno.ENOSPC, errno.EDQUOT)
        if full or shutil.disk_usage(out).free < 1 << 20:
            raise OutputError(f"{out}: the disk is full; free some space and give the same command again") from fault
        raise


def _depth_maps(work: Path, key: str, shots: Sequence[Shot], images: Path, masks: Path, options: Options) -> DepthMaps:
    dense = options.surface == "dense" or (options.surface == "auto" and len(shots) <= _MOST_DENSE)
    if not dense:
        say(f"{len(shots)} photos: surface through the sparse points")
        return Sparse(relief_of(shots), masks)
    swept = stage(work, "sweeps", key, options.depth_size)
    maps = Dense(shots, images, masks, swept.folder, options.depth_size)
    _guarded(work.parent, maps.sweep_all)
    return maps


def _unplaced(photos: Sequence[Photo], mapped: Mapped) -> list[tuple[str, str]]:
    placed, told = set(mapped.registered), []
    for photo in photos:
        if photo.output not in placed and photo.name not in mapped.unreadable:
            count, other = mapped.best_matches.get(photo.name, (0, ""))
            told.append(
                (photo.name, f"{count} matches at best, with {other}" if count else "no matches with those placed")
            )
    return told


def _warnings(photos: Sequence[Photo], mapped: Mapped, scale: Scale) -> list[str]:
    warnings, missing = [], _unplaced(photos, mapped)
    if missing:
        named = "; ".join(f"{name} ({why})" for name, why in missing[:4])
        more = f" and {len(missing) - 4} more" if len(missing) > 4 else ""
        fault = f"{len(missing)} of {len(photos)} photos have no place in the scene: {named}{more}"
        warnings.append(f"{fault}; add photos between them and the others, or mask what moves")
    if len(mapped.groups) > 1 and mapped.groups[1] > 2:
        sizes = " and ".join(map(str, mapped.groups))
        warnings.append(f"the photos fall into groups of {sizes} that share no views; only the first is used")
    if not scale.is_metric:
        warnings.append(
            "the scale is arbitrary: depths are not metres, and a beta or gamma fitted on them is per unit, not"
            " 1/m; restored colours do not depend on it. For metres give --distance, --length, --depth-track or --scale"
        )
    return warnings


def _write(
    out: Path,
    pinhole: Path,
    shots: Sequence[Shot],
    maps: DepthMaps,
    scale: Scale,
    folder: Path,
    left_out: Sequence[tuple[str, str]],
    warnings: Sequence[str],
    mapped: Mapped,
    options: Options,
) -> tuple[Quality, ...]:
    pycolmap = load_pycolmap()
    model = pycolmap.Reconstruction(pinhole)
    model.transform(pycolmap.Sim3d(scale.metres_per_unit, pycolmap.Rotation3d(), np.zeros(3)))
    (out / "sparse").mkdir(exist_ok=True)
    model.write_binary(out / "sparse")

    on_page, pictures, qualities = shown([shot.name for shot in shots]), {}, []
    depths = np.concatenate([shot.seen_points()[1] for shot in shots])
    bounds = tuple(np.quantile(depths, [0.02, 0.98]))
    for shot in track(shots, "depth maps"):
        depth = maps.depth(shot)
        write_depth(out / "depths", shot.name, depth * np.float32(scale.metres_per_unit))
        qualities.append(quality_of(shot, depth, scale.metres_per_unit))
        if shot.name in on_page:
            pictures[shot.name] = thumbnails(out / "images" / shot.name, depth, bounds)

    track_length, error = (
        model.compute_mean_track_length(),
        np.average([q.reprojection_px for q in qualities], weights=[q.points for q in qualities]),
    )
    facts = [
        ("photos placed", f"{len(shots)} of {len(shots) + len(left_out)}, at the {mapped.attempt} attempt"),
        ("sparse points", f"{model.num_points3D()}, each seen by {track_length:.1f} photos"),
        ("reprojection error", f"{error:.2f} px"),
        ("pixels with depth", f"{100 * np.mean([q.coverage for q in qualities]):.0f} %"),
        ("depth against sparse points", f"{100 * np.nanmedian([q.depth_error for q in qualities]):.2f} % (median)"),
        (
            "surface",
            "plane sweep, confirmed by other photos" if isinstance(maps, Dense) else "relief of the sparse points",
        ),
        ("scale", scale.note),
    ]
    write_page(
        out / "quality.html",
        out.resolve().name,
        "m" if scale.is_metric else "of no unit",
        facts,
        warnings,
        left_out,
        qualities,
        pictures,
    )
    packages = ("sucre-bench", "pycolmap", "opencv-python-headless", "open3d", "numpy")
    record: dict[str, Any] = {
        "photos": str(folder.resolve()),
        "options": {f.name: str(getattr(options, f.name)) for f in fields(options)},
        "scale": asdict(scale),
        "facts": dict(facts),
        "cameras": {number: str(camera) for number, camera in pycolmap.Reconstruction(mapped.model).cameras.items()},
        "left_out": dict(left_out),
        "warnings": list(warnings),
        "images": [{k: None if v != v else v for k, v in asdict(q).items()} for q in qualities],
        "versions": {name: importlib.metadata.version(name) for name in packages},
    }
    write_atomically(out / "prepare.json", json.dumps(record, indent=1).encode())
    return tuple(qualities)
