"""Arrays in files that are mapped into memory: for more observations than memory holds, and to keep them."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.multiview.observations import Seen

__all__ = ["Spool", "new_file"]


def new_file(folder: Path, name: str, shape: tuple[int, ...], dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """Return a new array in FOLDER/NAME.npy, to be filled. OSError when the disk is too full for it."""
    path = folder / f"{name}.npy"
    array = np.lib.format.open_memmap(path, mode="w+", dtype=np.dtype(dtype), shape=shape)
    with path.open("r+b") as file:  # without this, a full disk would end the process when a page is written
        os.posix_fallocate(file.fileno(), 0, path.stat().st_size)
    return array


class Spool:
    """What views show of a target, kept in a file without a name, which goes when nothing of it is in use."""

    def __init__(self, folder: Path) -> None:
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115, closed on exit
        self._parts: list[tuple[str, dict[str, tuple[int, np.dtype[Any], tuple[int, ...]]]]] = []

    def __enter__(self) -> Spool:
        return self

    def __exit__(self, kind: type[BaseException] | None, fault: BaseException | None, at: TracebackType | None) -> None:
        self._file.close()

    def append(self, seen: Seen) -> None:
        """Write a view's part. OSError when the disk is full."""
        where = {}
        for field in ("pixels", "distance", "colour", "ray"):
            values = getattr(seen, field)
            if values is not None:
                where[field] = (self._file.tell(), values.dtype, values.shape)
                self._file.write(np.ascontiguousarray(values).data)
                self._file.write(bytes(-values.nbytes % 8))  # every array begins where its type may
        self._parts.append((seen.name, where))

    def parts(self) -> list[Seen]:
        """Return all parts as they were given, their arrays read from the file as they are used."""
        self._file.flush()
        whole = np.memmap(self._file, np.uint8, "r") if self._parts else None
        return [
            Seen(name, **{field: np.ndarray(shape, dtype, whole, at) for field, (at, dtype, shape) in where.items()})
            for name, where in self._parts
        ]
