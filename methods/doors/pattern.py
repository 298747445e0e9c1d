"""Finds the image that was made of a view, by name.

The image of ``left/a.jpg`` is ``left/a`` in the folder, of any kind that can be read; or else the only ``a`` in it, at
any depth, provided that no other view of the scene is called ``a``. A pattern says how names differ:
"restored_{stem}" is ``left/restored_a.png``. One with a slash is a path from the folder, and nothing else is tried.
One that ends in {name} or in a suffix, "{stem}_out.tif", is a whole file name.
"""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath

from sucre_bench.errors import InputError, NotApplicableError
from sucre_bench.methods.doors.template import placeholders

__all__ = ["SUFFIXES", "check_pattern", "find_image", "inside"]

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".npy", ".npz")


def check_pattern(pattern: str, option: str) -> None:
    """Raise InputError unless a pattern tells views apart and has no placeholder but {stem}, {name} and {parent}."""
    used = placeholders(pattern, ("name", "parent", "stem"), option)
    if not used & {"stem", "name"}:
        raise InputError(f"{option}: '{pattern}' is the same for every view; put {{stem}} into it")


def inside(name: str) -> PurePosixPath:
    """Return a view's name as a path, or raise InputError where it leads out of the folder that it is taken in."""
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or not path.name:
        raise InputError(f"{name}: is no path inside a folder; rename the view")
    return path


def find_image(folder: Path, name: str, names: Sequence[str], pattern: str = "{stem}") -> Path:
    """Return the image of the view of that name. names: of all the scene's views.

    Raises InputError where two files may be the view's, or a file another view's as well, or it lies elsewhere;
    NotApplicableError, saying what was looked for, where there is none.
    """
    whole = pattern.endswith("{name}") or pattern.lower().endswith(SUFFIXES)
    own = _place(inside(name), pattern)
    others = {other: _place(PurePosixPath(other), pattern) for other in names if other != name}
    found = [own.parent / file for file in _listed(folder / own.parent) if _bare(file, whole) == own.name]
    rivals = [other for other, place in others.items() if place == own]
    if not found and "/" not in pattern:
        belonging = set(others.values())  # a file in another view's place is not this one's
        found = [path for path in _below(folder) if _bare(path.name, whole) == own.name]
        found = [path for path in found if path.with_name(own.name) not in belonging]
        rivals = [other for other, place in others.items() if place.name == own.name]
    if not found:
        raise NotApplicableError(f"{name}: {_looked_for(folder, own, whole, '/' in pattern)}")
    if len(found) > 1:
        fault = f"{found[1]} in {folder} is there as well"
        raise InputError(f"{folder / found[0]}: {fault}; keep one, or tell them apart with pattern='{{stem}}.png'")
    if rivals:
        fault = f"may belong to {name} or {rivals[0]}"
        raise InputError(f"{folder / found[0]}: {fault}; use sub-folders as the views do, or pattern='{{name}}'")
    if not (folder / found[0]).resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{folder / found[0]}: leads out of the folder; copy the file into it")
    return folder / found[0]


def _place(name: PurePosixPath, pattern: str) -> PurePosixPath:
    """Where a view's image should be, relative to the folder; without suffix, unless the pattern has one."""
    filled = PurePosixPath(pattern.format(stem=name.stem, name=name.name, parent=name.parent))
    return filled if "/" in pattern else name.parent / filled


def _bare(file: str, whole: bool) -> str:
    """A file's name, without suffix unless it is to be compared as a whole."""
    return file if whole else PurePosixPath(file).stem


def _listed(folder: Path) -> list[str]:
    """The names of the images in a folder, sorted; none where there is no such folder."""
    try:
        return sorted(path.name for path in folder.iterdir() if path.name.lower().endswith(SUFFIXES))
    except (FileNotFoundError, NotADirectoryError):
        return []


def _below(folder: Path) -> Iterator[PurePosixPath]:
    for place, _, files in os.walk(folder):
        yield from (
            PurePosixPath((Path(place) / file).relative_to(folder).as_posix())
            for file in sorted(files)
            if file.lower().endswith(SUFFIXES)
        )


def _looked_for(folder: Path, own: PurePosixPath, whole: bool, exact: bool) -> str:
    """Why nothing was found: what was looked for, and what comes near."""
    there = [str(path if whole else path.with_suffix("")) for path in _below(folder)]
    if not there:
        return f"there are no images in {folder}"
    tried = [str(own)] if exact or own.parent == PurePosixPath() else [str(own), own.name]
    near = difflib.get_close_matches(tried[0], there, n=1, cutoff=0) or there[:1]
    kinds = "" if whole else f" (any of {', '.join(SUFFIXES)})"
    return f"no image in {folder} is named {' or '.join(tried)}{kinds}; the nearest of {len(there)} is {near[0]}"
