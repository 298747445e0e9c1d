"""Locks that say whom they wait for."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sucre_bench.machine import progress

__all__ = ["waited_lock"]

_SILENT_S = 3.0


@contextmanager
def waited_lock(path: Path) -> Iterator[None]:
    """Hold a lock file in this block. After 3 s of waiting, say which process holds it and how to go on.

    Raises OSError if the file cannot be made.
    """
    from filelock import FileLock, Timeout

    lock = FileLock(path)
    try:
        lock.acquire(timeout=_SILENT_S)
    except Timeout:
        progress.say(f"waiting  {path}: {_held_by(path)}")
        lock.acquire()
    try:
        yield
    finally:
        lock.release()


def _held_by(path: Path) -> str:
    process = _holder(path)
    if process is None:
        return "another process, perhaps of another machine, holds this lock; wait for it, or end it there"
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
