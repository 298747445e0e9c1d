"""A store of arrays in files: the processes of a run share them, and memory-map them.

A file is written beside its place and moved there, so nobody maps half of one. When the folder is full, the files
that were used longest ago are removed; whoever has mapped one keeps it. Without a store, or where the disk fails,
arrays are made again.
"""

import hashlib
import os
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[Any]

# A smaller array is made as fast as its file is found.
_LEAST_BYTES = 1 << 18
# Makers of arrays whose keys share a lock wait for each other; a lock a key would make too many files.
_N_LOCKS = 64


@dataclass(frozen=True)
class ArrayStore:
    """A folder of arrays. most_bytes: what its files may fill together."""

    folder: Path
    most_bytes: float

    def get(self, key: str, make: Callable[[], Values]) -> Values:
        """Return the array of a key, read-only and mapped from its file; made, and stored, where there is none."""
        path = self.folder / f"{hashlib.blake2b(key.encode(), digest_size=16).hexdigest()}.npy"
        if (found := _mapped(path)) is not None:
            return found
        with self._lock(path.name):
            if (found := _mapped(path)) is not None:  # another process or thread has made it
                return found
            made = make()
            if not _LEAST_BYTES <= made.nbytes <= self.most_bytes:
                return made
            with suppress(OSError):
                self._write(path, made)
        found = _mapped(path)
        return made if found is None else found

    def _write(self, path: Path, values: Values) -> None:
        self._make_room(values.nbytes)
        part = path.with_suffix(f".{uuid.uuid4().hex}.part")
        try:
            with part.open("wb") as file:
                np.lib.format.write_array(file, np.ascontiguousarray(values), allow_pickle=False)
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)

    def _make_room(self, n_bytes: int) -> None:
        """Remove files, those used longest ago first, until there is room."""
        files = []
        for entry in os.scandir(self.folder):
            with suppress(OSError):  # removed just now
                state = entry.stat()
                if entry.name.endswith(".npy"):
                    files.append((state.st_mtime_ns, state.st_size, entry.path))
        filled = sum(size for _, size, _ in files) + n_bytes
        for _, size, place in sorted(files):
            if filled <= self.most_bytes:
                return
            Path(place).unlink(missing_ok=True)
            filled -= size

    @contextmanager
    def _lock(self, name: str) -> Iterator[None]:
        from filelock import FileLock, Timeout

        lock = FileLock(self.folder / f"{int(name[:8], 16) % _N_LOCKS}.lock")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            lock.acquire()
        except (OSError, Timeout):  # no locks here, or no place to write to
            yield
            return
        try:
            yield
        finally:
            lock.release()


def _mapped(path: Path) -> Values | None:
    """The array in a file; None if there is none, or it is damaged."""
    try:
        values = np.asarray(np.load(path, mmap_mode="r", allow_pickle=False))
        os.utime(path)
    except (OSError, ValueError, EOFError):
        return None
    return values


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
