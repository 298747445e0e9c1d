"""Finds, in a folder, the image files that another program's export names.

Exports name images by absolute paths of another computer, by other relative paths, or by a label without suffix. The
image is the file whose path shares the most last parts with that name. Files outside the folder are never used.
"""

from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from sucre_bench.imaging.image_files import SUFFIXES
from sucre_bench.loading.find_folders import walk


class ImageFolder:
    """The images in a folder and its sub-folders."""

    def __init__(self, folder: Path) -> None:
        self._by_stem: dict[str, list[str]] = defaultdict(list)
        for place, _, names in walk(folder):
            for name in names:
                if name.lower().endswith(SUFFIXES):
                    relative = (place / name).relative_to(folder).as_posix()
                    self._by_stem[without_suffix(name).lower()].append(relative)

    def find(self, name: str) -> list[str]:
        """Return the files (relative, posix) that a name may mean: one, none, or several equally good ones."""
        wanted = _parts(name.lower())
        files = self._by_stem.get(without_suffix(wanted[-1]), []) if wanted else []
        exact = [file for file in files if _parts(file.lower())[-1] == wanted[-1]]
        return _best(wanted, exact or files)


def without_suffix(name: str) -> str:
    """Return a file's name without an image's suffix; other text after a dot is part of the name."""
    path = PurePosixPath(name)
    return path.stem if path.suffix.lower() in SUFFIXES else path.name


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
        folders = list(zip(reversed(wanted[:-1]), reversed(_parts(file.lower())[:-1]), strict=False))
        agree = next((i for i, (one, other) in enumerate(folders) if one != other), len(folders))
        whole = len(_parts(file)) == len(wanted)
        ranked[agree, whole and agree == len(wanted) - 1].append(file)
    return sorted(ranked[max(ranked)]) if ranked else []
