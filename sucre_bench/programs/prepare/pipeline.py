"""Runs the stages in order, from a folder of photos to a folder that dataset=colmap reads."""

import errno
import hashlib
import json
import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

from sucre_bench.errors import InputError, PluginError, SucreBenchError
from sucre_bench.loading.colmap_model import read_model
from sucre_bench.loading.lens import Lens
from sucre_bench.machine.files import (
    check_working_folder,
    is_want_of_room,
    not_writable,
    read_json,
    write_atomically,
)
from sucre_bench.machine.progress import say
from sucre_bench.programs.prepare import Options
from sucre_bench.programs.prepare.depth_maps import (
    INTERPOLATED,
    DepthMap,
    DepthMaps,
    masked,
    of_surface,
    relief,
    swept,
)
from sucre_bench.programs.prepare.given import given_model, mesh_maps, network_maps
from sucre_bench.programs.prepare.mapping import Mapped, map_photos
from sucre_bench.programs.prepare.photos import Photo, find_photos, too_few
from sucre_bench.programs.prepare.result import Prepared, read_record, write_result
from sucre_bench.programs.prepare.scale import Known, Scale, find_scale
from sucre_bench.programs.prepare.shots import Shot, read_shots, undistort

_MOST_DENSE = 500  # photos: about an hour of plane sweeps on two cores


class _Stage(NamedTuple):
    """A stage's folder, a hash of its inputs and of the stages before it, and the file that marks it as done."""

    folder: Path
    key: str
    done: Path


def _stage(work: Path, name: str, *depends: object, outdated: Iterable[Path] = ()) -> _Stage:
    """Return the stage of that name under `work`. When its inputs change, its files for others are removed.

    outdated: other files of the stage, for which the same holds.
    """
    key = hashlib.blake2b(repr(depends).encode(), digest_size=6).hexdigest()
    folder = work / f"{name}-{key}"
    if not folder.is_dir():
        for old in (*work.glob(f"{name}-*"), *outdated):
            shutil.rmtree(old, ignore_errors=True)
        folder.mkdir(parents=True)
    return _Stage(folder, key, folder / "done")


def prepare(
    folder: Path,
    out: Path,
    options: Options | None = None,
    known: Known | None = None,
    again: bool = False,
) -> Prepared:
    """Turn a folder of photos into images, a model and depth maps below `out`; finished stages are not repeated.

    known: see `known_scale`; without it the scale of an earlier command stays; again: replace an `out` that was made
    with other options.
    Raises InputError if photos or options are unusable, OutputError if `out` cannot be written.
    """
    try:
        return _prepare(folder, out, options or Options(), known or {}, again)
    except Exception as fault:
        # what any library raises, or how COLMAP dies, when the disk is full
        is_own = isinstance(fault, SucreBenchError) and not isinstance(fault, PluginError)
        if not is_own and out.exists() and shutil.disk_usage(out).free < 1 << 20:
            raise not_writable(out, OSError(errno.ENOSPC, "")) from fault
        if isinstance(fault, OSError) and is_want_of_room(fault):
            raise not_writable(out, fault) from fault
        raise


def _asked(folder: Path, options: Options) -> dict[str, Any]:
    """The photos and options as the record has them."""
    values = {
        name: value.resolve() if isinstance(value, Path) else value
        for name, value in asdict(options).items()
    }
    asked: dict[str, Any] = json.loads(
        json.dumps({"photos": folder.resolve(), **values}, default=str)
    )
    return asked


def _longest_swept(options: Options, n_placed: int) -> int:
    """The longest side in pixels of swept images; 0 if nothing is to be swept."""
    if options.mesh or options.depth:
        return 0
    is_small = options.surface == "auto" and n_placed <= _MOST_DENSE
    return options.depth_size if options.surface == "dense" or is_small else 0


def _mapped(
    folder: Path,
    photos: Sequence[Photo],
    damaged: Mapping[str, str],
    mapping: _Stage,
    options: Options,
) -> Mapped:
    """Return the cameras of photos, or what the user's model says of them. Raises InputError if no photo is placed."""
    if damaged and not mapping.done.is_file():  # before mapping, which may take long
        say(
            f"{len(damaged)} of {len(photos) + len(damaged)} photos are damaged, {min(damaged)} among them"
        )
    if options.model is None:
        mapped = map_photos(photos, mapping.folder, options)
    else:
        mapped = given_model(options.model, photos, folder, mapping.folder, options)
    if not mapped.registered:
        raise too_few(folder, len(photos) + len(damaged), {**damaged, **mapped.damaged})
    if not mapping.done.is_file():
        mapping.done.touch()
    return mapped


def _prepare(folder: Path, out: Path, options: Options, known: Known, again: bool) -> Prepared:
    work, images = out / ".prepare", out / "images"
    check_working_folder(out, ".prepare", [folder])
    photos, damaged = find_photos(folder, options.masks, options.max_size, out)
    before = read_record(out)
    asked = _asked(folder, options)
    _check_asked(work / "options.json", asked, again or before is None)

    rules = options.matching, options.camera, options.cameras, *filter(None, [options.focal])
    mapping = _stage(
        work, "model", [photo.stamp for photo in photos], rules, *_stamps(options.model)
    )
    mapped = _mapped(folder, photos, damaged, mapping, options)
    damaged |= mapped.damaged

    straight = _stage(
        work, "images", mapping.key, outdated=[images, out / "depths", out / "sparse"]
    )
    pinhole, masks = straight.folder / "sparse", straight.folder / "masks"
    are_there = all((images / name).is_file() for name in mapped.registered)
    if not (straight.done.is_file() and are_there):
        if options.model is None:
            _check_lens(mapped.model, images, folder)
        undistort(
            {photo.output: photo for photo in photos}, mapped.model, images, masks, pinhole
        )
        straight.done.touch()

    longest = _longest_swept(options, len(mapped.registered))
    given_depth = (*_stamps(options.mesh), *_stamps(options.depth))
    surface = _stage(work, "sweeps", straight.key, longest, "fused", *given_depth)
    keys = mapping.key, surface.key
    scale, known, is_kept, warnings = settled_scale(before, known, keys)
    if before is not None and scale is not None and before.is_whole:
        result = _stage(work, "result", surface.key, scale, sorted(damaged))
        if result.done.is_file():
            return replace(before, is_new=False, is_kept=is_kept)

    shots = read_shots(pinhole)
    if not any(len(shot.points) for shot in shots):
        fault = "its poses give the photos no point in common"
        raise InputError(
            fault, options.model or folder, "see that the model was made of these photos"
        )
    outputs = {photo.name: photo.output for photo in photos}
    lenses = {one.name: one.lens for one in read_model(mapped.model, images, distorted=True)}
    made_from, given, faults = _depth_maps(
        options, shots, outputs, lenses, longest, images, masks, surface.folder
    )

    def maps(shot: Shot) -> DepthMap:
        depth, origin = given(shot)
        return DepthMap(masked(depth, shot, masks), masked(origin, shot, masks))

    scale = scale or find_scale(
        known, shots, outputs, lambda shot: maps(shot).depth, options.model is not None
    )
    unplaced = _unplaced(photos, mapped, options.model)
    warnings += _warnings(mapped, len(unplaced), faults)
    made = Prepared(out, (), damaged, unplaced, scale, known, warnings, keys, True, is_kept)
    result = _stage(work, "result", surface.key, scale, sorted(damaged))
    result.done.unlink(missing_ok=True)
    made = write_result(made, pinhole, mapped, shots, (made_from, maps), asked, result.folder)
    result.done.touch()
    return made


def _check_lens(model: Path, images: Path, folder: Path) -> None:
    """Raise InputError if the lens that was found for photos cannot be undone: then their places are wrong, too."""
    try:
        read_model(model, images, distorted=True)
    except InputError as wrong:
        fault = "the lens that was found for these photos is impossible"
        remedy = "give its focal length with --focal, or sharper photos that overlap more"
        raise InputError(fault, folder, remedy) from wrong


def _depth_maps(
    options: Options,
    shots: Sequence[Shot],
    outputs: Mapping[str, str],
    lenses: Mapping[str, Lens | None],
    longest: int,
    images: Path,
    masks: Path,
    folder: Path,
) -> tuple[str, DepthMaps, dict[str, str]]:
    """What depth maps are made from, for people, the maps, and the faults of photos that get none.

    longest: see `swept`, 0: no plane sweep; folder: of this stage.
    """
    if options.mesh:
        return "mesh, given", mesh_maps(options.mesh, shots), {}
    if options.depth:
        return network_maps(
            options.depth,
            shots,
            {output: name for name, output in outputs.items() if output in lenses},
            lenses,
        )
    if longest:
        return (
            "plane sweeps of all photos, fused",
            swept(shots, images, masks, folder, longest),
            {},
        )
    say(f"{len(shots)} photos: surface through the sparse points")
    return "relief of the sparse points", of_surface(relief(shots), INTERPOLATED), {}


def _stamps(path: Path | None) -> list[object]:
    """What identifies the version of a file, or of the files of a folder."""
    if path is None:
        return []
    files = (
        [path] if path.is_file() else sorted(file for file in path.rglob("*") if file.is_file())
    )
    return [
        path.resolve(),
        *((file.name, file.stat().st_size, file.stat().st_mtime_ns) for file in files),
    ]


def _check_asked(file: Path, asked: Mapping[str, Any], again: bool) -> None:
    """Refuse to replace a result made with other options by accident; the scale may always change."""
    before = read_json(file, "name a new folder") if file.is_file() else asked
    if not isinstance(before, dict):
        raise InputError("is not what prepare wrote", file, "name a new folder")
    for name, value in asked.items():
        if not again and before.get(name) != value:
            fault = f"was prepared with {name}={before.get(name)}, not {value}"
            raise InputError(
                fault, file.parent.parent, "name another folder, or add --again to make it anew"
            )
    if before != asked or not file.is_file():
        write_atomically(file, json.dumps(asked, indent=1).encode())


def settled_scale(
    before: Prepared | None, known: Known, keys: tuple[str, str]
) -> tuple[Scale | None, Known, bool, tuple[str, ...]]:
    """Return the scale, None if it has to be found from what is known; that; whether it is an earlier one; warnings.

    before: an earlier result in the same folder; keys: those of the result to be made. A newly given scale counts
    first. Else the scale of the same model is valid. For another model the distances and the depth track stay valid; a
    factor and the pixels of lengths do not.
    """
    if before is None or (known and (known != before.known or keys != before.keys)):
        return None, known, False, ()
    if known:
        return before.scale, known, False, ()
    if keys[0] == before.keys[0]:
        return before.scale, before.known, before.scale.is_metric, ()
    if "distances" in before.known or "depth_track" in before.known:
        return None, before.known, True, ()
    old = f"the scale of before ({before.scale.note}) was of another model; give it again"
    return None, known, False, (old,) if before.scale.is_metric else ()


def _unplaced(photos: Sequence[Photo], mapped: Mapped, model: Path | None) -> dict[str, str]:
    """Photos that the model lacks, each with its best matches and the remedy."""
    unplaced = {}
    for photo in photos:
        if photo.output in mapped.registered or photo.name in mapped.damaged:
            continue
        if model is not None:
            unplaced[photo.name] = (
                f"{model} has no pose for it; place it there, or prepare without --model"
            )
        else:
            count, other = mapped.best_matches.get(photo.name, (0, ""))
            best = (
                f"{count} matches at best, with {other}"
                if count
                else "no matches with those placed"
            )
            remedy = "add photos between it and the others, or mask what moves"
            unplaced[photo.name] = f"no place found, {best}; {remedy}"
    return unplaced


def _warnings(mapped: Mapped, unplaced: int, faults: Mapping[str, str]) -> tuple[str, ...]:
    """What to know of a model, of photos without a place in it, and of those without a depth map, by their faults."""
    warnings = [f"no depth for {name}: {why}" for name, why in faults.items()]
    if unplaced > 1 and mapped.attempt != "given":
        sizes = (
            f" (groups of {' and '.join(map(str, mapped.groups[1:]))} fit each other)"
            if mapped.groups[1:]
            else ""
        )
        apart = f"{unplaced} photos fit nowhere among the {len(mapped.registered)} that are used{sizes}"
        remedy = "prepare another place from a folder of its own, add photos between, or hold a known --focal"
        warnings.insert(0, f"{apart}; {remedy}")
    if mapped.has_logo:
        wrong = "something stands at one place of all photos, as a logo does, and its depth is wrong"
        warnings.insert(0, f"{wrong}; mask it with `sucre-bench prepare --masks`")
    return tuple(warnings)
