"""Observations kept on disk: paired once, used by every method and every run that asks for the same.

An entry is a folder of .npy files and a `meta.json`, named after the target and a hash of all that decides the result:
the data, the views, the options and the source that pairs. It is made beside its place, under a lock, and moved there
when complete; one that is damaged is made anew.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import inspect
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Any, BinaryIO, Unpack

import numpy as np

from sucre_bench.errors import ANY_FAULT, InputError
from sucre_bench.machine.code import engine_hash
from sucre_bench.machine.progress import say
from sucre_bench.multiview.observations import Observations
from sucre_bench.multiview.observe import Options, observe
from sucre_bench.scene import Scene, View

__all__ = ["paired", "sharing"]

_PER_OBSERVATION = ("distance", "colour", "view", "ray")
_PER_PIXEL = ("pixels", "counts", "starts")


_parameters = inspect.signature(observe).parameters
_DEFAULTS = {name: _parameters[name].default for name in Options.__annotations__}

# Where methods share what they pair, and how many bytes it may fill.
_shared: ContextVar[tuple[Path, float] | None] = ContextVar("shared", default=None)


@contextmanager
def sharing(folder: Path, most_bytes: float) -> Iterator[None]:
    """Let methods that are given no folder share this one inside, as long as there is room for more in it."""
    token = _shared.set((folder, most_bytes))
    try:
        yield
    finally:
        _shared.reset(token)


def _shared_folder() -> Path | None:
    if (shared := _shared.get()) is None:
        return None
    folder, most_bytes = shared
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        filled = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
        return folder if filled < min(most_bytes, shutil.disk_usage(folder).free / 2) else None
    return None


def paired(scene: Scene, target: View, folder: Path | None = None, **options: Unpack[Options]) -> Observations:
    """Return `observe(target, scene.views, **options)`, from a folder if it is there, and kept there if it is not.

    folder: None keeps nothing, unless methods share a folder, see `sharing`. With one, arrays are mapped from files and
    memory stays small however many there are; what is done to them stays in memory; pair_s is how long pairing took,
    whenever that was. A scene without a data_id cannot be told from another, and is not kept.
    Raises what `observe` raises; InputError when the folder cannot be written.
    """
    if folder is None and scene.data_id and (shared := _shared_folder()):
        try:
            return paired(scene, target, shared, **options)
        except InputError:  # whoever shares it has removed it, or the disk is full: nobody asked for it
            return observe(target, scene.views, **options)
    if folder is None:
        return observe(target, scene.views, **options)
    if not scene.data_id:
        _say_that_nothing_is_kept(scene.name)
        return observe(target, scene.views, **options)
    from filelock import FileLock

    entry = Path(folder).expanduser() / f"{Path(target.name).stem}-{_key(scene, target, options)}"
    try:
        entry.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(f"{entry}.lock"):  # of two processes, the later finds what the first has made
            kept = _read(entry)
            if kept is not None and not kept.unreadable:  # a view that could not be read may be there again
                return kept
            made = _make(entry, scene, target, options)
    except OSError as fault:
        reason = fault.strerror or fault
        raise InputError(f"{entry.parent}: cannot keep observations there, {reason}; name another folder") from fault
    return made


@functools.cache
def _say_that_nothing_is_kept(scene: str) -> None:
    say(f"{scene}: its observations are not kept, the scene has no data_id to know them by")


def _key(scene: Scene, target: View, options: Options) -> str:
    names = [view.name for view in scene.views]
    decided: dict[str, object] = {**_DEFAULTS, **options}
    if decided["rule"] == "mutual":
        del decided["tolerance"]  # of depths, which that rule does not compare
    content = json.dumps([scene.data_id, target.name, names, decided, engine_hash()], sort_keys=True)
    return hashlib.blake2b(content.encode(), digest_size=8).hexdigest()


def _make(entry: Path, scene: Scene, target: View, options: Options) -> Observations:
    """Pair into a new entry, in place of whatever is there, and return what was kept."""
    work = Path(f"{entry}.part")
    shutil.rmtree(work, ignore_errors=True)  # of a process that was killed
    work.mkdir()
    try:
        made = observe(target, scene.views, folder=work, **options)
        for name in _PER_PIXEL:
            with (work / f"{name}.npy").open("wb") as file:
                np.save(file, getattr(made, name))
                _to_disk(file)
        for name in _PER_OBSERVATION:
            if isinstance(values := getattr(made, name), np.memmap):
                values.flush()  # or a crash of the machine could leave zeros in a file that looks whole
        meta = {"shape": made.shape, "views": made.views, "unreadable": made.unreadable, "pair_s": made.pair_s}
        arrays = {name: _layout(getattr(made, name)) for name in (*_PER_PIXEL, *_PER_OBSERVATION)}
        with (work / "meta.json").open("wb") as file:
            file.write(json.dumps({**meta, "arrays": arrays}).encode())
            _to_disk(file)
        if entry.exists():
            shutil.rmtree(entry)
        work.replace(entry)
    finally:
        shutil.rmtree(work, ignore_errors=True)
    kept = _read(entry)
    assert kept is not None
    return dataclasses.replace(kept, read_s=made.read_s)


def _to_disk(file: BinaryIO) -> None:
    file.flush()
    os.fsync(file.fileno())


def _is_whole(kept: Observations) -> bool:
    """Whether the arrays go together: compiled loops follow these numbers without a look."""
    height, width = kept.shape
    slots = len(kept.pixels) - np.cumsum(np.bincount(kept.counts))[:-1]  # pixels with more than k observations
    return bool(
        len(kept.pixels) == len(kept.counts)
        and (np.diff(kept.counts) <= 0).all()
        and np.array_equal(kept.starts, np.concatenate([[0], np.cumsum(slots)]))
        and kept.starts[-1] == len(kept)
        and kept.distance.min() > 0
        and np.isfinite(kept.distance.max())
        and np.bincount(kept.pixels, minlength=height * width).max() == 1
        and len(np.bincount(kept.pixels)) <= height * width
    )


def _layout(values: np.ndarray | None) -> list[Any] | None:
    return None if values is None else [values.dtype.str, list(values.shape)]


def _read(entry: Path) -> Observations | None:
    """Return an entry's observations; None when it is not there or not whole."""
    try:
        meta = json.loads((entry / "meta.json").read_text(encoding="utf-8"))
        arrays: dict[str, Any] = {}
        for name, layout in meta["arrays"].items():
            if layout is not None:
                # Copy on write: nobody can harm the file, and libraries that want writable arrays need no copy.
                arrays[name] = np.asarray(np.load(entry / f"{name}.npy", mmap_mode="c", allow_pickle=False))
                if _layout(arrays[name]) != layout:
                    return None
        height, width = meta["shape"]
        about: dict[str, Any] = {"unreadable": tuple(meta["unreadable"]), "pair_s": float(meta["pair_s"])}
        kept = Observations((height, width), tuple(meta["views"]), **about, **arrays)
        return kept if _is_whole(kept) else None
    except ANY_FAULT:  # NumPy's reader and the JSON of a damaged file raise nearly anything
        return None
