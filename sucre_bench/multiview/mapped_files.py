"""Arrays in memory-mapped files, for more observations than memory holds."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.multiview.observations import Seen


def new_file(folder: Path, name: str, shape: tuple[int, ...], dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    """Return a new, unfilled array in FOLDER/NAME.npy. Raises OSError if the disk has no room for it."""
    path = folder / f"{name}.npy"
    array = np.lib.format.open_memmap(path, mode="w+", dtype=np.dtype(dtype), shape=shape)
    with path.open("r+b") as file:  # else a full disk would kill the process when a page is written
        os.posix_fallocate(file.fileno(), 0, path.stat().st_size)
    return array


class Spool:
    """The observations of several views in an unnamed file, which is removed when nothing uses it any more."""

    def __init__(self, folder: Path) -> None:
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115, closed on exit
        self._parts: list[tuple[str, dict[str, tuple[int, np.dtype[Any], tuple[int, ...]]]]] = []

    def __enter__(self) -> Spool:
        return self

    def __exit__(self, kind: type[BaseException] | None, fault: BaseException | None, at: TracebackType | None) -> None:
        self._file.close()

    def append(self, seen: Seen) -> None:
        """Write a view's observations. Raises OSError if the disk is full."""
        where = {}
        for field in ("pixels", "distance", "colour", "ray"):
            values = getattr(seen, field)
            if values is not None:
                where[field] = (self._file.tell(), values.dtype, values.shape)
                self._file.write(np.ascontiguousarray(values).data)
                self._file.write(bytes(-values.nbytes % 8))  # align each array to its type
        self._parts.append((seen.name, where))

    def parts(self) -> list[Seen]:
        """Return the observations of all views; their arrays are read from the file when used."""
        self._file.flush()
        whole = np.memmap(self._file, np.uint8, "r") if self._parts else None
        return [
            Seen(name, **{field: np.ndarray(shape, dtype, whole, at) for field, (at, dtype, shape) in where.items()})
            for name, where in self._parts
        ]
