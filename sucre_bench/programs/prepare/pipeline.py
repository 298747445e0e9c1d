"""Runs the stages in order, from a folder of photos to a folder that dataset=colmap reads."""

import errno
import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from sucre_bench.errors import InputError, OutputError, SucreBenchError
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.progress import say
from sucre_bench.programs.prepare.make_depth_maps import Dense, DepthMaps, Sparse, is_dense
from sucre_bench.programs.prepare.mapping import Mapped, Rules, map_photos, read_mapped
from sucre_bench.programs.prepare.options import Options
from sucre_bench.programs.prepare.photos import Photo, find_photos, too_few
from sucre_bench.programs.prepare.prepare_json import Prepared, given, read_record, settled_by
from sucre_bench.programs.prepare.registered_photos import Shot, read_shots
from sucre_bench.programs.prepare.relief import relief_of
from sucre_bench.programs.prepare.resumable_stages import Stage, stage
from sucre_bench.programs.prepare.scale import Known, Scale, find_scale
from sucre_bench.programs.prepare.undistort import undistort
from sucre_bench.programs.prepare.write_scene import write_scene


def prepare(
    folder: Path, out: Path, options: Options | None = None, known: Known | None = None, again: bool = False
) -> Prepared:
    """Turn a folder of photos into images, a model and depth maps below `out`; finished stages are not repeated.

    known: without it the scale of an earlier command stays; again: replace an `out` that was made with other options.
    Raises InputError if photos or options are unusable, OutputError if `out` cannot be written.
    """
    options, known = options or Options(), known or Known()
    work = out / ".prepare"
    _check_folders(folder, out)
    photos, damaged = find_photos(folder, options.masks, options.max_size, out)
    before = read_record(out)
    _check_options(work, _asked(folder, options), again)

    rules = Rules(options.matching, options.camera, options.cameras)
    mapping = stage(work, "model", [photo.stamp for photo in photos], rules)
    if damaged and read_mapped(mapping.folder) is None:  # before mapping, which may take long
        say(f"{len(damaged)} of {len(photos) + len(damaged)} photos are damaged, {min(damaged)} among them")
    mapped = _model(photos, mapping.folder, out, rules)
    if not mapped.registered:
        raise too_few(folder, len(photos) + len(damaged), damaged | mapped.damaged)
    damaged |= mapped.damaged

    straight = stage(work, "images", mapping.key)
    pinhole, masks = straight.folder / "sparse", straight.folder / "masks"
    _undistort(photos, mapped, out, straight)

    dense = is_dense(options.surface, len(mapped.registered))
    surface = stage(work, "sweeps", straight.key, options.depth_size if dense else 0)
    keys = mapping.key, surface.key
    settled = settled_by(before, known, keys)
    if before is not None and settled.scale is not None:
        done = stage(work, "result", surface.key, settled.scale, sorted(damaged)).done
        if done and before.is_whole:
            return replace(before, is_new=False, is_kept=settled.is_kept)

    shots = read_shots(pinhole)
    maps = _depth_maps(shots, out / "images", masks, surface, options.depth_size if dense else None)
    output_of, placed = {photo.name: photo.output for photo in photos}, {shot.name: shot for shot in shots}
    scale = settled.scale or find_scale(settled.known, shots, output_of, lambda name: maps.depth(placed[name]))
    warnings = (*settled.warnings, *_warnings(mapped, scale))
    made = Prepared(
        out, (), damaged, _unplaced(photos, mapped), scale, given(settled.known), warnings, keys, True, settled.is_kept
    )
    more = {**_asked(folder, options), "attempt": mapped.attempt}
    result = stage(work, "result", surface.key, scale, sorted(damaged))
    with _full_disk_named(out):
        made = write_scene(made, pinhole, mapped.model, shots, maps, more, result.folder)
    result.finish()
    return made


def _check_folders(folder: Path, out: Path) -> None:
    if out.exists() and not out.is_dir():
        raise OutputError(f"{out}: is a file; name a folder to write into")
    if folder.resolve() == out.resolve() or out.resolve() in folder.resolve().parents:
        raise InputError(f"{out}: holds the photos themselves; name another folder to write into")
    if out.is_dir() and any(out.iterdir()) and not (out / ".prepare").is_dir():
        gone = " and no .prepare/ to go on from" if read_record(out) else ""
        raise InputError(f"{out}: holds other files already{gone}; name a new folder")


def _asked(folder: Path, options: Options) -> dict[str, Any]:
    """Photos and options as plain data for JSON."""
    values = {"photos": folder.resolve(), **asdict(options)}
    values["masks"] = options.masks and options.masks.resolve()
    return {name: str(value) if isinstance(value, Path) else value for name, value in values.items()}


def _check_options(work: Path, asked: Mapping[str, Any], again: bool) -> None:
    """Refuse to replace a result made with other options by accident; the scale may always change."""
    file = work / "options.json"
    before = json.loads(file.read_text()) if file.is_file() else {}
    if before == asked:
        return
    for name, value in asked.items():
        if before and not again and before.get(name) != value:
            was = f"was prepared with {name}={before.get(name)}, not {value}"
            raise InputError(f"{work.parent}: {was}; name another folder, or add --again to make it anew")
    for made in ("images", "depths", "sparse"):
        shutil.rmtree(work.parent / made, ignore_errors=True)
    for old in work.glob("images-*"):
        shutil.rmtree(old)
    write_atomically(file, json.dumps(asked, indent=1).encode())


def _model(photos: Sequence[Photo], folder: Path, out: Path, rules: Rules) -> Mapped:
    """The model of an earlier command, or a new one."""
    before = read_mapped(folder)
    if before is not None:
        return before
    with _full_disk_named(out):
        made = map_photos(photos, folder, rules)
    if made.registered:
        for name in ("images", "depths"):  # of another model
            shutil.rmtree(out / name, ignore_errors=True)
    made.write(folder)
    return made


@contextmanager
def _full_disk_named(out: Path) -> Iterator[None]:
    """Turn write errors of libraries in this block into an OutputError that names a full disk if it is one."""
    try:
        yield
    except SucreBenchError:
        raise
    except Exception as fault:
        full = isinstance(fault, OSError) and fault.errno in (errno.ENOSPC, errno.EDQUOT)
        if full or shutil.disk_usage(out).free < 1 << 20:
            raise OutputError(f"{out}: the disk is full; free some space and repeat the command") from fault
        raise


def _undistort(photos: Sequence[Photo], mapped: Mapped, out: Path, straight: Stage) -> None:
    """Write the undistorted images and their model, unless they are there."""
    if straight.done and all((out / "images" / name).is_file() for name in mapped.registered):
        return
    by_output = {photo.output: photo for photo in photos}
    masks, pinhole = straight.folder / "masks", straight.folder / "sparse"
    with _full_disk_named(out):
        undistort(by_output, mapped.model, out / "images", masks, pinhole)
    straight.finish()


def _depth_maps(shots: Sequence[Shot], images: Path, masks: Path, swept: Stage, longest: int | None) -> DepthMaps:
    """Plane sweeps at this longest side in pixels; without one, the relief of the sparse points."""
    if longest is None:
        say(f"{len(shots)} photos: surface through the sparse points")
        return Sparse(relief_of(shots), masks)
    maps = Dense(shots, images, masks, swept.folder, longest)
    with _full_disk_named(images.parent):
        maps.sweep_all()
    return maps


def _unplaced(photos: Sequence[Photo], mapped: Mapped) -> dict[str, str]:
    """Photos that the model lacks, each with its best matches and the remedy."""
    told = {}
    for photo in photos:
        if photo.output not in mapped.registered and photo.name not in mapped.damaged:
            count, other = mapped.best_matches.get(photo.name, (0, ""))
            best = f"{count} matches at best, with {other}" if count else "no matches with those placed"
            told[photo.name] = f"no place found, {best}; add photos between it and the others, or mask what moves"
    return told


def _warnings(mapped: Mapped, scale: Scale) -> list[str]:
    warnings = []
    if len(mapped.groups) > 1 and mapped.groups[1] > 2:
        sizes = " and ".join(map(str, mapped.groups))
        warnings.append(f"the photos fall into groups of {sizes} that share no views; only the first is used")
    if not scale.is_metric:
        warnings.append(
            "the scale is arbitrary: depths are not metres, and a beta or gamma fitted on them is per unit, not"
            " 1/m; restored colours do not depend on it. For metres give --distance, --length, --depth-track or --scale"
        )
    return warnings
