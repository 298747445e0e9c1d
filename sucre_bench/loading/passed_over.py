"""Counts and names what lies beside the files that were read: other formats, videos, maps, images of no view."""

from collections import Counter
from collections.abc import Collection, Iterable
from pathlib import Path

from sucre_bench.imaging.image_files import SUFFIXES
from sucre_bench.loading.depth_maps import DEPTH_SUFFIXES, depth_suffix
from sucre_bench.loading.find_folders import walk
from sucre_bench.machine.files import FRAMES, VIDEOS
from sucre_bench.machine.progress import is_watched, say

# Photographs that need the programs of cameras and telephones.
OTHER_FORMATS = (
    *(
        ".arw",
        ".avif",
        ".cr2",
        ".cr3",
        ".crw",
        ".dng",
        ".gpr",
        ".heic",
        ".heif",
        ".insp",
        ".j2k",
        ".jfif",
    ),
    *(".jp2", ".jpe", ".jxl", ".nef", ".nrw", ".orf", ".pef", ".raf", ".rw2", ".srw"),
)
EXPORT = "export them as .jpg, .png or .tif"
_NOTES = (
    *(
        ".cfg",
        ".csv",
        ".db",
        ".htm",
        ".html",
        ".ini",
        ".json",
        ".jsonl",
        ".log",
        ".md",
        ".pdf",
        ".py",
        ".sh",
        ".txt",
    ),
    *(".xml", ".xmp", ".yaml", ".yml"),
)
_TABLES = (".csv", ".txt")  # notes, unless they are named after a picture or a depth map
_MODEL = {"images.bin", "images.txt"}
_OURS = "depth_origin"  # a folder that `prepare` writes
_MOST = 6  # kinds in a line

_said: set[str] = set()


def folders_in(folder: Path, but: Iterable[Path] = ()) -> list[Path]:
    """Return a folder and those below it, without hidden folders and the folders `but`."""
    found = []
    left_out = {place.resolve() for place in but}
    for place, below, _ in walk(folder):
        below[:] = [
            name
            for name in below
            if not name.startswith(".") and (place / name).resolve() not in left_out
        ]
        found.append(place)
    return found


def other_photographs(folder: Path) -> list[Path]:
    """Return the photographs below a folder that are in a format that is not read."""
    return [
        path
        for place in folders_in(folder)
        for path in _files(place)
        if path.suffix.lower() in OTHER_FORMATS
    ]


def say_passed_over(
    root: Path, folders: Iterable[Path], read: Iterable[Path], beside: bool = False
) -> None:
    """Say how many files of which kind in folders were not read, in one line, once.

    folders: without those below them; read: the files that were; beside: look for pictures, videos and depth maps in
    the other folders in `root`, too. Notes of people and programs, and COLMAP's models, are left out.
    """
    folders = dict.fromkeys(map(Path.absolute, folders))
    known = {path.absolute() for path in read}
    stems = {path.stem for path in known}
    found = Counter[tuple[Path, str]]()
    for folder in folders:
        files = _files(folder, stems)
        if not _MODEL & {path.name for path in files}:
            found.update((folder, _kind(path)) for path in files if path not in known)
    others = (
        sorted(path for path in root.absolute().iterdir() if path.is_dir()) if beside else []
    )
    for folder in others:
        if folder.name != _OURS and not any(folder in (one, *one.parents) for one in folders):
            kinds = (*SUFFIXES, *OTHER_FORMATS, *VIDEOS, *DEPTH_SUFFIXES, *_TABLES)
            found.update(
                (folder, _kind(path))
                for path in _files(folder, stems)
                if path.suffix and _kind(path) in kinds
            )
    if not found:
        return
    counts = [f"{n} {kind}{_within(root, folder)}" for (folder, kind), n in found.items()]
    counts[_MOST:] = [f"and {len(counts) - _MOST} kinds more"] if len(counts) > _MOST else []
    kinds_found = {kind for _, kind in found}
    remedies = [EXPORT] if kinds_found & {*OTHER_FORMATS} else []
    remedies += [f"{FRAMES} reads a video"] if kinds_found & {*VIDEOS} else []
    line = f"{root}: not read: {', '.join(counts)}" + "".join(
        f"; {remedy}" for remedy in remedies
    )
    if is_watched() and line not in _said:
        _said.add(line)
        say(line)


def _files(folder: Path, stems: Collection[str] = ()) -> list[Path]:
    """The files in a folder, in order of name, without hidden ones and notes. stems: of the files that were read."""

    def is_note(path: Path) -> bool:
        is_named = path.suffix.lower() in _TABLES and path.stem.removeprefix("depth_") in stems
        return path.suffix.lower() in _NOTES and not is_named

    there = sorted(folder.iterdir()) if folder.is_dir() else []
    return [
        path for path in there if path.is_file() and path.name[0] != "." and not is_note(path)
    ]


def _kind(path: Path) -> str:
    return (depth_suffix(path.name) or path.suffix or "without suffix").lower()


def _within(root: Path, folder: Path) -> str:
    root = root.absolute()
    return (
        ""
        if folder == root
        else f" in {folder.relative_to(root) if root in folder.parents else folder}"
    )
