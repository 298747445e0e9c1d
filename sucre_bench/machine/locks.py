"""File locks that name the process which holds them."""

import errno
import functools
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sucre_bench.errors import InputError
from sucre_bench.machine import progress

_SILENT_S = 3.0
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)


@contextmanager
def waited_lock(path: Path, patience_s: float = -1) -> Iterator[None]:
    """Hold a lock file in this block. After 3 s of waiting, say which process holds it and how to go on.

    patience_s: how long to wait from then on before InputError is raised; -1: for ever.
    On a file system without locks, say so once and go on without: what the block does must lose nothing then.
    Raises OSError if the file cannot be made.
    """
    from filelock import FileLock, Timeout

    lock = FileLock(path)
    try:
        with warnings.catch_warnings(action="ignore"):  # of a file system without locks, which is said below
            lock.acquire(timeout=_SILENT_S)
    except Timeout:
        progress.say(f"waiting  {path}: {_held_by(path)}")
        try:
            lock.acquire(timeout=patience_s)
        except Timeout:
            raise InputError(f"{path}: {_held_by(path)}") from None
    except (OSError, NotImplementedError) as fault:
        if isinstance(fault, OSError) and fault.errno not in _NO_LOCKS:
            raise
        _say_that_there_are_no_locks(path.parent)
    try:
        yield
    finally:
        lock.release()


@functools.cache
def _say_that_there_are_no_locks(folder: Path) -> None:
    progress.say(f"{folder}: this file system has no locks; run one command at a time here, two may do the same work")


def _held_by(path: Path) -> str:
    process = _holder(path)
    if process is None:
        who = "another process, perhaps of another machine, holds this lock"
        return f"{who}; wait for it, or delete the file if no command is at work here"
    with suppress(OSError):
        words = Path(f"/proc/{process}/cmdline").read_bytes().split(b"\0")
        name = f" ({' '.join(Path(os.fsdecode(word)).name for word in words[:3] if word)})"
        return f"process {process}{name} holds this lock; wait for it, or end it with `kill {process}`"
    return f"process {process} holds this lock; wait for it, or end it with `kill {process}`"


def _holder(path: Path) -> int | None:
    """The process of this machine that holds a lock on a file, as Linux lists it."""
    with suppress(OSError, ValueError, IndexError):
        inode = str(path.stat().st_ino)
        for line in Path("/proc/locks").read_text(encoding="ascii").splitlines():
            words = line.split()
            if "->" not in words and words[5].rpartition(":")[2] == inode:
                return int(words[4]) if int(words[4]) > 0 else None
    return None
