"""Makes a file or folder once for all processes: whole or not at all, and again if it is damaged.

`ArrayStore` is such a folder of arrays, which the processes of a run share and memory-map.
"""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from sucre_bench.errors import InputError
from sucre_bench.machine import progress

Made = TypeVar("Made")
Values = npt.NDArray[Any]

_SILENT_S = 3.0
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)


@contextmanager
def waited_lock(
    path: Path, patience_s: float = -1, silent_s: float = _SILENT_S
) -> Iterator[None]:
    """Hold a lock file in this block. After `silent_s` of waiting, say so, and how to go on.

    patience_s: how long to wait from then on before InputError is raised; -1: for ever.
    On a file system without locks, a file takes the lock's place, and is removed afterwards. One that a killed process
    left is ignored on its own machine. Raises OSError if the file cannot be made.
    """
    from filelock import BaseFileLock, FileLock, SoftFileLock

    has_locks = _has_locks(path)
    lock: BaseFileLock = FileLock(path) if has_locks else SoftFileLock(f"{path}.held")
    held = "another process holds this lock; wait for it, or delete the file if no command is at work here"
    with warnings.catch_warnings(action="ignore"):  # of a file system without locks
        try:
            lock.acquire(timeout=silent_s)
        except TimeoutError:
            progress.say(f"waiting  {lock.lock_file}: {held}")
            try:
                lock.acquire(timeout=patience_s)
            except TimeoutError:
                raise InputError(f"{lock.lock_file}: {held}") from None
    try:
        yield
    finally:
        lock.release()


def _has_locks(path: Path) -> bool:
    """Whether files can be locked where a path is. Makes the file, or raises OSError: FileLock would wait for ever."""
    with path.open("a") as file:
        if sys.platform != "win32":
            import fcntl

            try:
                fcntl.flock(file, fcntl.LOCK_UN)
            except OSError as fault:
                if fault.errno not in _NO_LOCKS:
                    raise
                return False
    return True


def get_or_make(
    path: Path,
    read: Callable[[Path], Made | None],
    make: Callable[[Path], Made],
    lock: Path | None = None,
    silent_s: float = _SILENT_S,
) -> Made:
    """Return what a path holds, as `read` gives it; where that is None, make it. Others who want it wait.

    read: None where nothing is, or it is damaged; make: returns the same, and writes a file or folder to the path that
    it is given, which is moved into place. If it writes nothing, nothing is stored.
    Raises OSError if the folder cannot be written, and what `make` raises.
    """
    found = read(path)
    if found is not None:
        return found
    path.parent.mkdir(parents=True, exist_ok=True)
    with waited_lock(lock or Path(f"{path}.lock"), silent_s=silent_s):
        found = read(path)
        if found is not None:  # another process or thread has made it
            return found
        work = Path(f"{path}.part")
        _remove(work)  # left by a process that was killed
        try:
            made = make(work)
            if work.exists():
                if path.is_dir():
                    _remove(path)
                work.replace(path)
            return made
        finally:
            _remove(work)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


# A smaller array is made as fast as its file is found.
_LEAST_BYTES = 1 << 18
# Makers of arrays whose keys share a lock wait for each other; a lock a key would make too many files.
_N_LOCKS = 64


@dataclass(frozen=True)
class ArrayStore:
    """A folder of arrays.

    When it is full, the files that were used longest ago are removed; whoever has mapped one keeps it. Where the disk
    fails, arrays are made again.
    """

    folder: Path

    most_bytes: float
    """What its files may fill together."""

    def get(self, key: str, make: Callable[[], Values]) -> Values:
        """Return the array of a key, read-only and mapped from its file; made, and stored, where there is none."""
        name = hashlib.blake2b(key.encode(), digest_size=16).hexdigest()
        made: list[Values] = []

        def write(path: Path) -> Values:
            values = make()
            made.append(values)
            if not _LEAST_BYTES <= values.nbytes <= self.most_bytes:
                return values
            with suppress(OSError):
                self._make_room(values.nbytes)
            with path.open("wb") as file:
                np.save(file, np.ascontiguousarray(values), allow_pickle=False)
            return _mapped(path)

        def read(path: Path) -> Values | None:
            with suppress(OSError, ValueError, EOFError):
                values = _mapped(path)
                os.utime(path)
                return values
            return None

        lock = self.folder / f"{int(name[:8], 16) % _N_LOCKS}.lock"
        try:
            return get_or_make(self.folder / f"{name}.npy", read, write, lock, silent_s=-1)
        except OSError:  # the disk is full, or no place to write to
            return made[0] if made else make()

    def _make_room(self, n_bytes: int) -> None:
        """Remove files, those used longest ago first, until there is room."""
        states = {}
        for file in self.folder.glob("*.npy"):
            with suppress(OSError):  # removed just now
                states[file] = file.stat()
        filled = sum(state.st_size for state in states.values()) + n_bytes
        for file in sorted(states, key=lambda file: states[file].st_mtime_ns):
            if filled <= self.most_bytes:
                return
            file.unlink(missing_ok=True)
            filled -= states[file].st_size


def _mapped(path: Path) -> Values:
    return np.asarray(np.load(path, mmap_mode="r", allow_pickle=False))


# One for the process: threads ask for arrays too.
_current: list[ArrayStore] = []


@contextmanager
def storing(store: ArrayStore) -> Iterator[None]:
    """Share the arrays of this block through a store."""
    _current.append(store)
    try:
        yield
    finally:
        _current.remove(store)


def current() -> ArrayStore | None:
    """Return the store in use, if there is one."""
    return _current[-1] if _current else None
