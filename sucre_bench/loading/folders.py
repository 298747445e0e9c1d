"""Finds the folders of a dataset below the one that a user names, however deep it was unpacked."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

from sucre_bench.errors import InputError

__all__ = ["existing", "folders_below", "scene_name"]


def existing(root: Path, dataset: str) -> Path:
    """Return `root` with ~ expanded. InputError, naming the dataset's option, when it is not a folder."""
    root = Path(root).expanduser()
    if not root.is_dir():
        raise InputError(f"{root}: no such folder; give the one that holds the data as {dataset}.root=DIR")
    return root


def folders_below(root: Path, wanted: Callable[[Path, set[str]], bool]) -> Iterator[Path]:
    """Yield `root` and the folders below it, in order of name, that `wanted(folder, names of its folders)` accepts.

    Links are followed; hidden folders, and what lies below an accepted one, are not looked into.
    """
    for place, below, _ in os.walk(root, followlinks=True):
        if wanted(Path(place), set(below)):
            yield Path(place)
            below.clear()
        below[:] = sorted(name for name in below if not name.startswith("."))


def scene_name(folder: Path, root: Path) -> str:
    """Return a scene's name: its path below the root, a part that repeats the one before (D1/D1) left out."""
    parts = folder.relative_to(root).parts or (folder.resolve().name,)
    return "_".join(part for part, before in zip(parts, ("", *parts), strict=False) if part != before)
