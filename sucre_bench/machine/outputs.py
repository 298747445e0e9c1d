"""The door for outputs that a user names: what a command may write over, and into which folders."""

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path

from sucre_bench.errors import InputError, NotAFileError, OutputError
from sucre_bench.machine.files import is_file, regular

ENDINGS: Mapping[str, tuple[str, ...]] = {
    "bundle": (".zip",),
    "contact sheet": (".png", ".jpg", ".jpeg"),
    "line-up": (".yaml", ".yml"),
    "numbers": (".json",),
    "page": (".html", ".htm"),
    "picture": (".png",),
    "surface": (".ply", ".glb"),
    "table": (".csv",),
    "video": (".mp4", ".webm"),
}
# What a file of ours has near its beginning: our name, the heads of a table of scores, or the first file of a bundle.
_MARKS = (b"sucre_bench", b"sucre-bench", b"dataset,scene,view,method,", b"bundle.json")
_LOOKED_AT = 1 << 16  # bytes

# What the commands write into a results folder; lineup.yaml, and files that a user puts there, are not among it.
_FILES = frozenset({"scores.parquet", "common.parquet", "config.yaml", "environment.json", "mlflow.db"})
_FOLDERS = frozenset({"parts", "restored", "views", "references", "report", "people", "tables", "figures", "pictures"})
_FOLDERS |= {"logs", ".pairs", ".decoded", ".at-work", "mlartifacts"}


def check_output(path: Path, kind: str, inputs: Iterable[Path] = (), force: bool = False) -> None:
    """Raise InputError if a command must not write to a path.

    kind: a key of `ENDINGS`, one of which the name must have, in small or capital letters; inputs: the files that the
    command reads. Also refused: a path where something is that is no regular file, a part of a results folder, and
    unless force is True a file that sucre_bench did not write.
    """
    if path.is_dir():
        example = path / f"{kind.split()[-1]}{ENDINGS[kind][0]}"
        raise InputError("is a folder", path, f"give a file, for example {example}")
    if path.suffix.lower() not in ENDINGS[kind]:
        noun = "picture" if kind == "contact sheet" else kind
        raise InputError(f"has no suffix of a {noun}", path, f"end it in {' or '.join(ENDINGS[kind])}")
    if _is_own_part(path):
        raise InputError("is a part of a results folder", path, "give a file elsewhere")
    try:
        regular(path)
    except FileNotFoundError:
        return
    except NotAFileError as fault:
        raise InputError(fault.fault, path, "give another file") from fault
    if any(is_file(one) and path.samefile(one) for one in inputs):
        raise InputError("is an input of this command", path, "give another file")
    if not force and not is_ours(path):
        raise InputError("is there, and sucre_bench did not write it", path, "give another file, or add --force")


def check_working_folder(out: Path, work: str, inputs: Iterable[Path], begun: str = "") -> None:
    """Raise InputError or OutputError if a command must not write into a folder.

    work: what is in it when the command continues there; inputs: folders of photographs that the command reads; begun:
    all that a command leaves there that was stopped before it wrote `work`.
    """
    if out.exists() and not out.is_dir():
        raise OutputError("is a file", out, "name a folder to write into")
    for folder in inputs:
        if out.resolve() in (folder.resolve(), *folder.resolve().parents):
            raise InputError("holds the photographs themselves", out, "name a folder elsewhere")
    others = {*out.glob("*"), *(out / work).parent.glob("*")} - {out / begun, (out / begun).parent}
    if others and not (out / work).exists():
        raise InputError(f"holds other files already, and no {work} to go on from", out, "name a new folder")
    check_links(out)


def is_ours(path: Path) -> bool:
    """Whether a file is empty, or one that sucre_bench wrote by what it begins with."""
    with suppress(OSError, InputError), regular(path).open("rb") as file:
        head = file.read(_LOOKED_AT)
        return not head or any(mark in head for mark in _MARKS)
    return False


def _is_own_part(path: Path) -> bool:
    """Whether a path is, or lies in, something that the commands keep in a results folder."""
    path = path.resolve()
    for folder in path.parents:
        if _is_results_folder(folder):
            first, *rest = path.relative_to(folder).parts
            return first in _FOLDERS if rest else first in _FILES
    return False


def _is_results_folder(folder: Path) -> bool:
    if any((folder / "parts").glob("*.parquet")):
        return any(is_ours(folder / name) for name in ("environment.json", "config.yaml"))
    return (folder / "scores.parquet").is_file()


def check_results_folder(folder: Path) -> None:
    """Raise InputError if a run must not write into a folder.

    A link there leads out of it, or it is no results folder and has files of the names that a run writes.
    """
    check_links(folder)
    if not _is_results_folder(folder) and not is_ours(folder / "environment.json"):
        taken = (folder / name for name in ("environment.json", "config.yaml", "lineup.yaml"))
        if path := next((path for path in taken if path.exists()), None):
            raise InputError("is there, and sucre_bench did not write it", path, "give another folder, out=results")


def check_links(folder: Path) -> None:
    """Raise InputError if a link in a folder leads out of it: to what must be neither published nor written over."""
    root = folder.resolve()
    for link in _links(folder):
        if not link.resolve().is_relative_to(root):
            raise InputError("leads out of the folder", link, "put the file itself there, or remove the link")


def _links(folder: Path) -> Iterator[Path]:
    """The links in a folder and the folders in it; a link is not followed."""
    with suppress(FileNotFoundError, NotADirectoryError, PermissionError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_symlink():
                yield Path(entry.path)
            elif entry.is_dir(follow_symlinks=False):
                yield from _links(Path(entry.path))
