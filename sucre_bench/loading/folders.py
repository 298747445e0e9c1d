"""Finds the folders of a dataset below the one that a user names, however deep it was unpacked."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

from sucre_bench.errors import InputError

__all__ = ["existing", "folders_below", "scene_name"]


def existing(root: Path, holds: str = "the data") -> Path:
    """Return `root` with ~ expanded. InputError, saying what it is to hold, when it is not a folder."""
    root = Path(root).expanduser()
    if not root.is_dir():
        fault = "is a file, not a folder" if root.exists() else "no such folder"
        raise InputError(f"{root}: {fault}; give the one that holds {holds} as dataset.root=DIR")
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
