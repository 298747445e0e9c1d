"""Runs the stages in order, from a folder of photos to a folder that dataset=colmap reads."""

import errno
import hashlib
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from sucre_bench.errors import InputError, OutputError, SucreBenchError
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.progress import say
from sucre_bench.programs.prepare.make_depth_maps import depth_maps, is_dense
from sucre_bench.programs.prepare.mapping import Mapped, Rules, map_photos, read_mapped
from sucre_bench.programs.prepare.options import Options
from sucre_bench.programs.prepare.photos import Photo, find_photos, too_few
from sucre_bench.programs.prepare.prepare_json import Prepared, given, read_record, settled_by
from sucre_bench.programs.prepare.registered_photos import read_shots
from sucre_bench.programs.prepare.scale import Known, Scale, find_scale
from sucre_bench.programs.prepare.undistort import undistort
from sucre_bench.programs.prepare.write_scene import write_scene


@dataclass(frozen=True, slots=True)
class Stage:
    """A stage's folder. key: a hash of its inputs and of the stages before it."""

    folder: Path
    key: str

    @property
    def done(self) -> bool:
        """Whether its result exists."""
        return (self.folder / "done").is_file()

    def finish(self) -> None:
        """Mark the stage as done."""
        write_atomically(self.folder / "done", b"")


def stage(work: Path, name: str, *depends: object) -> Stage:
    """Return the stage of that name under `work`; its files for other inputs or options are removed."""
    key = hashlib.blake2b(repr(depends).encode(), digest_size=6).hexdigest()
    folder = work / f"{name}-{key}"
    for old in work.glob(f"{name}-*"):
        if old != folder:
            shutil.rmtree(old)
    folder.mkdir(parents=True, exist_ok=True)
    return Stage(folder, key)


def prepare(
    folder: Path, out: Path, options: Options | None = None, known: Known | None = None, again: bool = False
) -> Prepared:
    """Turn a folder of photos into images, a model and depth maps below `out`; finished stages are not repeated.

    known: without it the scale of an earlier command stays; again: replace an `out` that was made with other options.
    Raises InputError if photos or options are unusable, OutputError if `out` cannot be written.
    """
    try:
        return _prepare(folder, out, options or Options(), known or Known(), again)
    except SucreBenchError:
        raise
    except Exception as fault:  # also write errors of libraries
        full = isinstance(fault, OSError) and fault.errno in (errno.ENOSPC, errno.EDQUOT)
        if full or (out.exists() and shutil.disk_usage(out).free < 1 << 20):
            raise OutputError(f"{out}: the disk is full; free some space and repeat the command") from fault
        raise


def _prepare(folder: Path, out: Path, options: Options, known: Known, again: bool) -> Prepared:
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
    if not (straight.done and all((out / "images" / name).is_file() for name in mapped.registered)):
        undistort({photo.output: photo for photo in photos}, mapped.model, out / "images", masks, pinhole)
        straight.finish()

    dense = is_dense(options.surface, len(mapped.registered))
    surface = stage(work, "sweeps", straight.key, options.depth_size if dense else 0)
    keys = mapping.key, surface.key
    settled = settled_by(before, known, keys)
    if before is not None and settled.scale is not None:
        done = stage(work, "result", surface.key, settled.scale, sorted(damaged)).done
        if done and before.is_whole:
            return replace(before, is_new=False, is_kept=settled.is_kept)

    shots = read_shots(pinhole)
    longest = options.depth_size if dense else None
    made_from, maps = depth_maps(shots, out / "images", masks, surface.folder, longest)
    output_of, placed = {photo.name: photo.output for photo in photos}, {shot.name: shot for shot in shots}
    scale = settled.scale or find_scale(settled.known, shots, output_of, lambda name: maps(placed[name]))
    warnings = (*settled.warnings, *_warnings(mapped, scale))
    made = Prepared(
        out, (), damaged, _unplaced(photos, mapped), scale, given(settled.known), warnings, keys, True, settled.is_kept
    )
    result = stage(work, "result", surface.key, scale, sorted(damaged))
    made = write_scene(made, pinhole, mapped, shots, maps, made_from, _asked(folder, options), result.folder)
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
    made = map_photos(photos, folder, rules)
    if made.registered:
        for name in ("images", "depths"):  # of another model
            shutil.rmtree(out / name, ignore_errors=True)
    made.write(folder)
    return made


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
