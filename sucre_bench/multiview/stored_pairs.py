"""Observations stored on disk: paired once, then used by every method and run with the same pairing options.

An entry is a folder of .npy files and a `meta.json`, named after the target and a hash of everything that decides the
result: data, views, options and the code that pairs. It is made in a temporary folder under a lock and moved into place
when complete. A damaged entry is made again.
"""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from sucre_bench.errors import ANY_FAULT, OutputError
from sucre_bench.machine.cache import get_or_make
from sucre_bench.machine.files import open_atomically, write_atomically
from sucre_bench.machine.provenance import engine_hash
from sucre_bench.multiview.observations import Observations
from sucre_bench.multiview.observe import Options, observe
from sucre_bench.scene import Scene, View

_PER_OBSERVATION = ("distance", "colour", "view", "ray")
_PER_PIXEL = ("pixels", "counts", "starts")


_parameters = inspect.signature(observe).parameters
_DEFAULTS = {name: _parameters[name].default for name in Options.__annotations__}

# The folder of observations that methods share, and the bytes that it may fill.
_shared: ContextVar[tuple[Path, float] | None] = ContextVar("shared", default=None)


@contextmanager
def sharing(folder: Path, most_bytes: float) -> Iterator[None]:
    """In this block, let methods share observations in this folder until it is full."""
    token = _shared.set((folder, most_bytes))
    try:
        yield
    finally:
        _shared.reset(token)


def _shared_folder() -> Path | None:
    shared = _shared.get()
    if shared is None:
        return None
    folder, most_bytes = shared
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        filled = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
        return folder if filled < min(most_bytes, shutil.disk_usage(folder).free / 2) else None
    return None


def paired(scene: Scene, target: View, **options: Unpack[Options]) -> Observations:
    """Return `observe(target, scene.views, **options)`, read from the folder that methods share, or stored there.

    Nothing is stored outside `sharing`, in a folder that cannot be written, and of a scene without a data_id, which
    cannot be identified. Stored arrays are mapped from files, so memory stays small. Changes to them stay in memory.
    pair_s: duration of the pairing, also if an earlier run did it. Raises what `observe` raises.
    """
    folder = _shared_folder() if scene.data_id else None
    if folder is None:
        return observe(target, scene.views, **options)
    stored: Options = {**options, "with_view": True}  # one entry serves both
    entry = folder / f"{Path(target.name).stem}-{_key(scene, target, stored)}"

    def read(entry: Path) -> Observations | None:
        found = _read(entry)
        # a file may be readable now
        return None if found is None or found.unreadable else found

    try:
        kept = get_or_make(entry, read, lambda work: _make(work, scene, target, stored))
    except (
        OSError,
        OutputError,
    ):
        # the folder was removed, or the disk is full: the user did not ask for it
        return observe(target, scene.views, **options)
    return kept if options.get("with_view") else dataclasses.replace(kept, view=None)


def _key(scene: Scene, target: View, options: Options) -> str:
    names = [view.name for view in scene.views]
    decided: dict[str, object] = {**_DEFAULTS, **options}
    content = json.dumps(
        [scene.data_id, target.name, names, decided, engine_hash()], sort_keys=True
    )
    return hashlib.blake2b(content.encode(), digest_size=8).hexdigest()


def _make(work: Path, scene: Scene, target: View, options: Options) -> Observations:
    """Pair into a new entry, and return it as it is stored."""
    work.mkdir()
    made = observe(target, scene.views, folder=work, **options)
    for name in _PER_PIXEL:
        with open_atomically(work / f"{name}.npy") as file:
            np.save(file, getattr(made, name))
    for name in _PER_OBSERVATION:
        if isinstance(values := getattr(made, name), np.memmap):
            values.flush()  # else a crash of the machine could leave zeros in a file of full length
    meta = {
        "shape": made.shape,
        "views": made.views,
        "unreadable": made.unreadable,
        "grey": made.grey,
        "pair_s": made.pair_s,
    }
    arrays = {name: _layout(getattr(made, name)) for name in (*_PER_PIXEL, *_PER_OBSERVATION)}
    write_atomically(work / "meta.json", json.dumps({**meta, "arrays": arrays}).encode())
    stored = _read(work)
    assert stored is not None
    return dataclasses.replace(stored, read_s=made.read_s)


def _is_whole(kept: Observations) -> bool:
    """Whether the stored arrays are consistent; the compiled loops do no bounds checks."""
    height, width = kept.shape
    # pixels with more than k observations
    slots = len(kept.pixels) - np.cumsum(np.bincount(kept.counts))[:-1]
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
    """Return an entry's observations; None if it does not exist or is damaged."""
    try:
        meta = json.loads((entry / "meta.json").read_text(encoding="utf-8"))
        arrays: dict[str, Any] = {}
        for name, layout in meta["arrays"].items():
            if layout is not None:
                # Copy on write: the file cannot be changed, and libraries that want writable arrays need no copy.
                arrays[name] = np.asarray(
                    np.load(entry / f"{name}.npy", mmap_mode="c", allow_pickle=False)
                )
                if _layout(arrays[name]) != layout:
                    return None
        height, width = meta["shape"]
        about: dict[str, Any] = {
            "unreadable": tuple(meta["unreadable"]),
            "grey": tuple(meta["grey"]),
            "pair_s": float(meta["pair_s"]),
        }
        kept = Observations((height, width), tuple(meta["views"]), **about, **arrays)
        return kept if _is_whole(kept) else None
    except ANY_FAULT:  # reading a damaged file raises errors of many kinds
        return None
