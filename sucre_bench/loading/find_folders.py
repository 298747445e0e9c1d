"""Finds the folders and files of a dataset below the folder that a user names, at any depth.

Exports of other programs name images by absolute paths of another computer, by other relative paths, or by a label
without suffix. `ImageFolder` finds the file whose path shares the most last parts with that name. Files outside the
folder are never used.
"""

import os
import re
import string
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import takewhile
from pathlib import Path, PurePosixPath
from typing import Literal, TypeAlias

from sucre_bench.errors import InputError, MissingFileError
from sucre_bench.imaging.image_files import SUFFIXES
from sucre_bench.machine.files import check_folder, expanded
from sucre_bench.machine.progress import say


def existing(root: Path, holds: str = "the data") -> Path:
    """Return `root` with ~ expanded. Raises InputError, naming the expected content, if it is no folder."""
    root = expanded(root)
    check_folder(root, f"give the one that holds {holds} as dataset.root=DIR")
    return root


def chosen(dataset: object, root: Path, option: str, kind: Literal["folder", "file"]) -> Path:
    """Return the path that an option names, in `root` or, with ~ expanded, of its own.

    Raises InputError if there is no folder or file, as `kind` says; the option's default need not be there.
    """
    check_chosen(dataset, [root], option, kind)
    return root / expanded(getattr(dataset, option))


def check_chosen(
    dataset: object, folders: Sequence[Path], option: str, kind: Literal["folder", "file"]
) -> None:
    """Raise InputError if none of the folders has the path that an option names, as `kind` says.

    The option's default need not be there.
    """
    given = getattr(dataset, option)
    places = [folder / expanded(given) for folder in folders]
    is_there = any(place.is_dir() if kind == "folder" else place.is_file() for place in places)
    if places and given != getattr(type(dataset), option) and not is_there:
        error, fault = (
            (InputError, f"is no {kind}")
            if places[0].exists()
            else (MissingFileError, f"no such {kind}")
        )
        others = f", in none of {len(places)} folders" if len(places) > 1 else ""
        raise error(f"{fault}{others}", places[0], f"correct or drop dataset.{option}={given}")


def walk(root: Path) -> Iterator[tuple[Path, list[str], list[str]]]:
    """Yield each folder from `root` down with the names of its folders and of its files, in order of name.

    Links are followed, after real folders. A folder that several paths lead to is yielded once, so circular links end.
    The caller may remove names from the list of folders: these are not entered. A folder below that this user must not
    list is left out with a line. Raises OSError if it is the root; a root that is not there has no files.
    """

    def unlisted(fault: OSError) -> None:
        if isinstance(fault, FileNotFoundError | NotADirectoryError):
            return
        if Path(fault.filename) == root:
            raise fault
        say(
            f"{fault.filename}: {fault.strerror}, so this folder is left out; let this user read it if it holds data"
        )

    seen = set()
    for place, below, names in os.walk(root, onerror=unlisted, followlinks=True):
        folder = Path(place)
        status = folder.stat()
        identity = (status.st_dev, status.st_ino)
        if identity in seen:
            below.clear()
            continue
        seen.add(identity)
        below.sort(key=lambda name: ((folder / name).is_symlink(), name))
        yield folder, below, sorted(names)


def folders_below(
    root: Path, wanted: Callable[[Path, set[str]], bool], lack: str = ""
) -> Iterator[Path]:
    """Yield `root` and the folders below it, in order of name, that `wanted(folder, names of its folders)` accepts.

    Links are followed as by `walk`. Hidden folders and folders below an accepted one are not entered. Where there is
    none, InputError is raised if `lack` says so: "fault; remedy".
    """
    for place, below, _ in walk(root):
        if wanted(place, set(below)):
            yield place
            below.clear()
            lack = ""
        below[:] = [name for name in below if not name.startswith(".")]
    if lack:
        raise InputError(f"{root}: {lack}")


def inside(root: Path, base: Path, named: str) -> Path | None:
    """Return the path, relative to `root`, that `named` means in a file in `base`; None if it leads out of `root`.

    Links are not resolved: the author of the file cannot have made them.
    """
    posix = named.replace("\\", "/")
    full, top = (Path(os.path.abspath(path)) for path in (base / posix, root))  # noqa: PTH100
    if top not in full.parents or "\0" in posix or posix[1:2] == ":":
        return None
    return full.relative_to(top)


def scene_name(folder: Path, root: Path) -> str:
    """Return a scene's name: its path below the root, without a part that repeats the one before (D1/D1)."""
    parts = folder.relative_to(root).parts or (folder.resolve().name,)
    return "_".join(
        part for part, before in zip(parts, ("", *parts), strict=False) if part != before
    )


Found: TypeAlias = Path | str | None  # a file, why it cannot be used, or none


def only(paths: Sequence[Path], remedy: str = "keep one of them") -> Found:
    """Return the one path, None if there is none, or what is wrong if there are several, with the remedy."""
    if len(paths) > 1:
        other = paths[1].name if paths[1].parent == paths[0].parent else paths[1]
        return f"{paths[0]}: {other} is there as well; {remedy}"
    return paths[0] if paths else None


class ImageFolder:
    """The images in a folder and its sub-folders, or its files of other suffixes too."""

    def __init__(self, folder: Path, suffixes: tuple[str, ...] = SUFFIXES) -> None:
        self._folder = folder
        self._by_stem = defaultdict[str, list[str]](list)
        for place, _, names in walk(folder):
            for name in names:
                if name.lower().endswith(suffixes):
                    relative = (place / name).relative_to(folder).as_posix()
                    self._by_stem[without_suffix(name).lower()].append(relative)

    def find(self, name: str) -> list[str]:
        """Return the files (relative, posix) that a name may mean: one, none, or several equally good ones."""
        wanted = _parts(name.lower())
        files = self._by_stem.get(without_suffix(wanted[-1]), []) if wanted else []
        exact = [file for file in files if _parts(file.lower())[-1] == wanted[-1]]
        return _best(wanted, exact or files)

    def find_one(self, name: str, of: str, remedy: str = "keep one of them") -> tuple[str, str]:
        """Return the file (relative, posix) that a name means, and "", or where it would be, and what is wrong.

        of: whose image it is; remedy: if several files fit.
        """
        fits = self.find(name)
        if len(fits) == 1:
            return fits[0], ""
        fault = f"no image is named like '{name}' of {of}; put it there"
        if fits:
            fault = f"{fits[0]} and {fits[1]} are named like '{name}' of {of}; {remedy}"
        return inner_path(name) or f"image of {of}", f"{self._folder}: {fault}"


def check_images(named: Iterable[tuple[str, str, str]]) -> None:
    """Raise InputError if two cameras have one image, or no image is there.

    named: of each camera its place, for messages, the name of its image, and why that is not there, or "".
    """
    owners: dict[str, str] = {}
    faults = []
    for place, name, fault in named:
        if name in owners:
            raise InputError(
                f"has the image {name}, as {owners[name]} has",
                place,
                "give it an image of its own",
            )
        owners[name] = place
        faults.append(fault)
    if all(faults):
        raise InputError(faults[0])


def without_suffix(name: str) -> str:
    """Return a file's name without an image's suffix; other text after a dot is part of the name."""
    path = PurePosixPath(name)
    return path.stem if path.suffix.lower() in SUFFIXES else path.name


def bare_stems(names: Iterable[str]) -> dict[str, str]:
    """Return the stem of each file in small letters, without what all begin or end with: "1" of "001_ours.png".

    Letters and digits beside what differs stay: "img10" and "img11" are whole words.
    """
    stems = {name: without_suffix(PurePosixPath(name).name).lower() for name in names}
    if len(set(stems.values())) < 2:
        return stems
    start = _common_start(stems.values())
    end = _common_start([stem[len(start) :][::-1] for stem in stems.values()])
    bare = {name: stem[len(start) : len(stem) - len(end)] for name, stem in stems.items()}
    short = {name: without_zeros(stem) for name, stem in bare.items()}
    return short if len({*short.values()}) == len({*bare.values()}) else bare


def without_zeros(stem: str) -> str:
    """Return a name without zeros before its numbers: "img1" of "img001"."""
    return re.sub(r"(?<!\d)0+(?=\d)", "", stem)


def _common_start(words: Iterable[str]) -> str:
    alike = takewhile(lambda letters: len(set(letters)) == 1, zip(*words, strict=False))
    return "".join(letters[0] for letters in alike).rstrip(
        string.ascii_lowercase + string.digits
    )


def inner_path(name: str) -> str:
    """Return a foreign path as a relative one (posix) that cannot leave a folder: no drive, root or ".."."""
    return "/".join(_parts(name))


def _parts(name: str) -> list[str]:
    parts = name.replace("\\", "/").replace("\0", "").split("/")
    return [part for part in parts if part not in ("", ".", "..") and not part.endswith(":")]


def _best(wanted: list[str], files: Iterable[str]) -> list[str]:
    """The files that agree with the most folders, read from the file's name upwards; of these, a whole path first."""
    ranked = defaultdict(list)
    for file in files:
        folders = list(
            zip(reversed(wanted[:-1]), reversed(_parts(file.lower())[:-1]), strict=False)
        )
        agree = next(
            (i for i, (one, other) in enumerate(folders) if one != other), len(folders)
        )
        whole = len(_parts(file)) == len(wanted)
        ranked[agree, whole and agree == len(wanted) - 1].append(file)
    return sorted(ranked[max(ranked)]) if ranked else []
