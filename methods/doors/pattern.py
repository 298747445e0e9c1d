"""Finds the restored image of a view by its file name.

The image of ``left/a.jpg`` is ``left/a`` in the folder, of any kind that can be read; or else the only ``a`` in it, at
any depth, provided that no other view of the scene is called ``a``. A pattern says how names differ:
"restored_{stem}" is ``left/restored_a.png``. One with a slash is a path from the folder, and nothing else is tried.
One that ends in {name} or in a suffix, "{stem}_out.tif", is a whole file name.
"""

import difflib
import functools
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from sucre_bench.errors import InputError, NotApplicableError
from sucre_bench.imaging import image_files
from sucre_bench.methods.doors.placeholders import placeholders

_ByName = dict[str, list[PurePosixPath]]

SUFFIXES = (*image_files.SUFFIXES, ".npy", ".npz")


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


@dataclass(frozen=True)
class ImageFolder:
    """The images in a folder, found by pattern. It lists each folder once: what is put there afterwards is not seen."""

    folder: Path
    pattern: str = "{stem}"
    _listed: dict[PurePosixPath, _ByName] = field(default_factory=dict, init=False, repr=False, compare=False)

    def find(self, name: str, names: Sequence[str]) -> Path:
        """Return the image of the view of that name. names: of all the scene's views.

        Raises InputError where two files may be the view's, or a file another view's as well, or it lies elsewhere;
        NotApplicableError, saying what was looked for, where there is none.
        """
        wanted = _place(inside(name), self.pattern)
        views = _views(tuple(names), self.pattern)
        found, rivals = self._beside(wanted.parent).get(wanted.name, []), views.at.get(wanted, ())
        if not found and "/" not in self.pattern:
            # A file in another view's place is not this one's.
            found = [path for path in self._below.get(wanted.name, []) if path.with_name(wanted.name) not in views.at]
            rivals = views.called.get(wanted.name, ())
        rival = next((other for other in rivals if other != name), None)
        if not found:
            raise NotApplicableError(f"{name}: {self._looked_for(wanted)}")
        path = self.folder / found[0]
        if len(found) > 1:
            fault = f"{found[1]} in {self.folder} is there as well"
            raise InputError(f"{path}: {fault}; keep one, or tell them apart with pattern='{{stem}}.png'")
        if rival:
            fault = f"may belong to {name} or {rival}"
            raise InputError(f"{path}: {fault}; use sub-folders as the views do, or pattern='{{name}}'")
        if not path.resolve().is_relative_to(self.folder.resolve()):
            raise InputError(f"{path}: leads out of the folder; copy the file into it")
        return path

    @property
    def _whole(self) -> bool:
        """Whether the pattern is of a whole file name, with its suffix."""
        return self.pattern.endswith("{name}") or self.pattern.lower().endswith(SUFFIXES)

    def _beside(self, parent: PurePosixPath) -> _ByName:
        """The images of one folder."""
        if parent not in self._listed:
            try:
                there = sorted(parent / path.name for path in (self.folder / parent).iterdir())
            except (FileNotFoundError, NotADirectoryError):
                there = []
            self._listed[parent] = self._by_name(there)
        return self._listed[parent]

    @functools.cached_property
    def _below(self) -> _ByName:
        """The images at any depth."""
        walk = ((Path(place).relative_to(self.folder).as_posix(), files) for place, _, files in os.walk(self.folder))
        return self._by_name(PurePosixPath(place, file) for place, files in walk for file in sorted(files))

    def _by_name(self, paths: Iterable[PurePosixPath]) -> _ByName:
        """Images, by what a pattern says of their name."""
        sorted_in: _ByName = {}
        for path in paths:
            if path.name.lower().endswith(SUFFIXES):
                sorted_in.setdefault(path.name if self._whole else path.stem, []).append(path)
        return sorted_in

    def _looked_for(self, wanted: PurePosixPath) -> str:
        """Why nothing was found: what was looked for, and what comes near."""
        there = [str(path if self._whole else path.with_suffix("")) for paths in self._below.values() for path in paths]
        if not there:
            return f"there are no images in {self.folder}"
        exact = "/" in self.pattern or wanted.parent == PurePosixPath()
        tried = [str(wanted)] if exact else [str(wanted), wanted.name]
        near = difflib.get_close_matches(tried[0], there, n=1, cutoff=0) or there[:1]
        kinds = "" if self._whole else f" (any of {', '.join(SUFFIXES)})"
        named = f"named {' or '.join(tried)}{kinds}"
        return f"no image in {self.folder} is {named}; the nearest of {len(there)} is {near[0]}"


def _place(name: PurePosixPath, pattern: str) -> PurePosixPath:
    """Where a view's image should be, relative to the folder; without suffix, unless the pattern has one."""
    filled = PurePosixPath(pattern.format(stem=name.stem, name=name.name, parent=name.parent))
    return filled if "/" in pattern else name.parent / filled


@dataclass(frozen=True)
class _Views:
    """The names of the views whose image belongs at a place, and of those whose image is called like that."""

    at: Mapping[PurePosixPath, Sequence[str]]
    called: Mapping[str, Sequence[str]]


@functools.lru_cache(maxsize=8)  # all views of a scene ask for the same
def _views(names: tuple[str, ...], pattern: str) -> _Views:
    at: dict[PurePosixPath, list[str]] = {}
    called: dict[str, list[str]] = {}
    for name in names:
        place = _place(PurePosixPath(name), pattern)
        at.setdefault(place, []).append(name)
        called.setdefault(place.name, []).append(name)
    return _Views(at, called)
