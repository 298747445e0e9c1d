"""Writes files atomically: a reader sees the old content or the new, never a part. Reads regular files only.

`check_output` and its siblings say what a command may write over, and into which folders.
"""

import errno
import json
import os
import shutil
import stat
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from sucre_bench.errors import (
    ANY_FAULT,
    DamagedFileError,
    DiskFullError,
    FileError,
    ForbiddenFileError,
    InputError,
    MissingFileError,
    NotAFileError,
    NotAFolderError,
    OutputError,
    SucreBenchError,
    file_error,
    in_words,
)
from sucre_bench.machine.processes import interrupts_held_back

_FULL = (errno.ENOSPC, errno.EDQUOT)
_TOO_MANY = (errno.EMFILE, errno.ENFILE)
_KINDS = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a named pipe", stat.S_IFSOCK: "a socket"}


VIDEOS = (
    ".360",
    ".avi",
    ".insv",
    ".lrv",
    ".m4v",
    ".mkv",
    ".mov",
    ".mp4",
    ".mts",
    ".mxf",
    ".webm",
    ".wmv",
)
FRAMES = "`ffmpeg -i VIDEO -vf fps=2 -qscale:v 2 FRAMES/%05d.jpg`"  # two pictures a second


def frames_of(path: Path | str) -> str:
    """Return the remedy where a video is given for pictures; empty for any other file."""
    return (
        f"take the video's frames with {FRAMES}" if str(path).lower().endswith(VIDEOS) else ""
    )


def expanded(path: str | Path) -> Path:
    """Return a path with ~ and ~name expanded. It stays as it is where no user has that name: then nothing is there."""
    return Path(os.path.expanduser(path))  # noqa: PTH111 - pathlib's raises RuntimeError there


def user_cache() -> Path:
    """Return the folder of this user's cache: what it holds can be made again."""
    from platformdirs import user_cache_path

    return user_cache_path("sucre_bench", appauthor=False)


def regular(path: Path, remedy: str = "") -> Path:
    """Return a path that leads to a regular file, for reading: a pipe or a device would perhaps never end.

    Raises FileNotFoundError if nothing is there, or MissingFileError where a remedy is given. NotAFileError for
    anything but a file, and ForbiddenFileError if the system does not say what it is. Nothing is opened.
    """
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        if remedy:
            raise MissingFileError("no such file", path, remedy) from None
        raise
    except PermissionError as fault:
        raise ForbiddenFileError(
            f"cannot be read, {fault.strerror}", path, "let this user read it"
        ) from fault
    except (OSError, ValueError) as fault:  # a name that no file system has, a link to itself
        said = f"cannot be read, {getattr(fault, 'strerror', fault)}"
        raise NotAFileError(said, path, "give another file") from fault
    if not stat.S_ISREG(mode):
        raise NotAFileError(
            f"is {_KINDS.get(stat.S_IFMT(mode), 'a device')}", path, "give a file"
        )
    return path


@contextmanager
def reading(path: Path, remedy: str) -> Iterator[None]:
    """Make a FileError of what reading a file in this block raises: damaged bytes raise errors of many kinds."""
    try:
        yield
    except (SucreBenchError, ImportError):
        raise
    except PermissionError as fault:
        raise file_error(path, fault, "let this user read it") from fault
    except OSError as fault:
        raise file_error(path, fault, remedy) from fault
    except ANY_FAULT as fault:
        raise DamagedFileError(f"cannot be read, {in_words(fault)}", path, remedy) from fault


def read_json(path: Path, remedy: str, of_data: bool = False) -> Any:
    """Return what a JSON file holds; None if nothing is there. Raises FileError if it cannot be read.

    of_data: raise FileError also for text that is no UTF-8, which names of views and charts cannot be.
    """
    with reading(path, remedy):
        try:
            content = json.loads(regular(path).read_bytes())
        except FileNotFoundError:
            return None
        if of_data:
            json.dumps(
                content, ensure_ascii=False
            ).encode()  # raises where "\\udce9" stands for what is no UTF-8
    return content


NO_FILE = "no such file"


def fault_of(path: Path) -> str:
    """Return why a path does not lead to a regular file, without the path: empty if it does."""
    try:
        regular(path)
    except FileNotFoundError:
        return NO_FILE
    except FileError as no_file:
        return no_file.fault
    return ""


def is_file(path: Path) -> bool:
    """Whether a path leads to a regular file; False also for a name that no file system has."""
    return os.path.isfile(path)  # noqa: PTH113 - pathlib's raises OSError for some names


def check_folder(path: Path, remedy: str) -> None:
    """Raise MissingFileError if nothing is there, NotAFolderError if it is no folder."""
    if not path.exists():
        raise MissingFileError("no such folder", path, remedy)
    if not path.is_dir():
        raise NotAFolderError("is a file, not a folder", path, frames_of(path) or remedy)


def write_atomically(path: Path, content: bytes | memoryview) -> None:
    """Write a file atomically, with its folders.

    Raises OutputError if the disk is full or the place cannot be written to.
    """
    with open_atomically(path) as file:
        file.write(content)


@contextmanager
def open_atomically(path: Path) -> Iterator[IO[bytes]]:
    """Yield a file that replaces `path` when this block ends well, and is removed when it does not.

    Raises OutputError if the disk is full, the place cannot be written to, or something is there that is no file.
    """
    unfinished = ""
    with writing(path):
        try:
            if path.exists() and not (path.is_file() or path.is_dir()):
                raise OutputError(
                    "is a device or a pipe, no file", path, "choose another place"
                )
            path.parent.mkdir(parents=True, exist_ok=True)
            with interrupts_held_back():
                descriptor, unfinished = tempfile.mkstemp(dir=path.parent, prefix=".writing-")
            with os.fdopen(descriptor, "wb") as file:
                yield file
                file.flush()
                os.fsync(descriptor)
                with suppress(PermissionError):
                    # some network disks have other rights; the file is what counts
                    os.fchmod(descriptor, 0o644)
                Path(unfinished).replace(path)
        except BaseException:
            with interrupts_held_back():
                if unfinished:
                    Path(unfinished).unlink(missing_ok=True)
            raise


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Yield a new folder for temporary files, which is removed at the end, however often this block is interrupted."""
    place = None
    try:
        with interrupts_held_back():
            place = Path(tempfile.mkdtemp(prefix="sucre-bench-"))
        yield place
    finally:
        with interrupts_held_back():
            if place:
                shutil.rmtree(place, ignore_errors=True)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Make an OutputError of an OSError in this block, which writes or removes a file."""
    try:
        yield
    except OSError as fault:
        raise not_writable(path, fault) from fault


def is_want_of_room(fault: OSError) -> bool:
    """Whether a file cannot be written because the disk is full or read-only, or too many files are open."""
    return fault.errno in (*_FULL, *_TOO_MANY, errno.EROFS, errno.EFBIG)


def not_writable(path: Path, fault: OSError) -> OutputError:
    """Return the error for a file that cannot be written."""
    if fault.errno in _FULL:
        return DiskFullError("the disk is full", path, "free some space and repeat the command")
    if blocking := next((folder for folder in path.parents if is_file(folder)), None):
        return OutputError("is a file", blocking, "name a folder to write into")
    return OutputError(f"cannot be written ({fault.strerror})", path, "choose another place")


ENDINGS: Mapping[str, tuple[str, ...]] = {
    "bundle": (".zip",),
    "contact sheet": (".png", ".jpg", ".jpeg"),
    "page": (".html", ".htm"),
    "picture": (".png",),
    "table": (".csv",),
}
# The file that makes a folder a results folder: a run writes it first.
RESULTS_MARK = "environment.json"


def check_output(
    path: Path, kind: str, inputs: Iterable[Path] = (), force: bool = False
) -> None:
    """Raise InputError if a command must not write to a path.

    kind: a key of `ENDINGS`, one of which the name must have, in small or capital letters; inputs: the files that the
    command reads. Also refused: a path where something is that is no regular file, and unless force is True any file.
    """
    if path.is_dir():
        example = path / f"{kind.split()[-1]}{ENDINGS[kind][0]}"
        raise InputError("is a folder", path, f"give a file, for example {example}")
    if path.suffix.lower() not in ENDINGS[kind]:
        noun = "picture" if kind == "contact sheet" else kind
        raise InputError(
            f"has no suffix of a {noun}", path, f"end it in {' or '.join(ENDINGS[kind])}"
        )
    try:
        regular(path)
    except FileNotFoundError:
        return
    except NotAFileError as fault:
        raise InputError(fault.fault, path, "give another file") from fault
    if any(is_file(one) and path.samefile(one) for one in inputs):
        raise InputError("is an input of this command", path, "give another file")
    if not force:
        raise InputError("exists", path, "give another file, or add --force")


def check_working_folder(out: Path, work: str, inputs: Iterable[Path]) -> None:
    """Raise InputError or OutputError if a command must not write into a folder.

    work: what is in it when the command continues there; inputs: folders of photographs that the command reads.
    """
    if out.exists() and not out.is_dir():
        raise OutputError("is a file", out, "name a folder to write into")
    for folder in inputs:
        if out.resolve() in (folder.resolve(), *folder.resolve().parents):
            raise InputError("holds the photographs themselves", out, "name a folder elsewhere")
    if any(out.glob("*")) and not (out / work).exists():
        raise InputError(
            f"holds other files already, and no {work} to go on from", out, "name a new folder"
        )
    check_links(out)


def check_results_folder(folder: Path) -> None:
    """Raise InputError if a run must not write into a folder.

    A link there leads out of it, or it is no results folder and has files of the names that a run writes.
    """
    check_links(folder)
    mark = folder / RESULTS_MARK
    is_marked = is_file(mark) and b"sucre_bench" in mark.read_bytes()
    # of a folder that was copied in part, or refused where it is read
    if is_marked or is_file(folder / "scores.parquet"):
        return
    for name in (RESULTS_MARK, "config.yaml", "experiment.yaml"):
        if (folder / name).exists():
            raise InputError(
                "is there, in a folder without results",
                folder / name,
                "give another folder, out=results",
            )


def check_links(folder: Path) -> None:
    """Raise InputError if a link in a folder leads out of it: to what must be neither published nor written over."""
    root = folder.resolve()
    for link in _links(folder):
        if not link.resolve().is_relative_to(root):
            raise InputError(
                "leads out of the folder", link, "put the file itself there, or remove the link"
            )


def _links(folder: Path) -> Iterator[Path]:
    """The links in a folder and the folders in it; a link is not followed."""
    with (
        suppress(FileNotFoundError, NotADirectoryError, PermissionError),
        os.scandir(folder) as entries,
    ):
        for entry in entries:
            if entry.is_symlink():
                yield Path(entry.path)
            elif entry.is_dir(follow_symlinks=False):
                yield from _links(Path(entry.path))
