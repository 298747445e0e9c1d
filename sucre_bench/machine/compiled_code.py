"""numba's cache of compiled code on the disk, with a checksum in each file: a damaged one is made again.

A machine that loses power leaves such files: numba does not wait until they are on the disk. This module imports numba;
only compute.compile_loop imports it.
"""

from __future__ import annotations

import glob
import hashlib
import pickle
from contextlib import suppress
from pathlib import Path
from typing import Any

from numba.core.caching import FunctionCache, IndexDataCacheFile

_SUM_BYTES = 16


class CheckedCache(FunctionCache):
    """The cache of one function. What a full disk does not take is compiled again in the next process."""

    def __init__(self, loop: Any) -> None:
        super().__init__(loop)
        self._base = self._impl.filename_base
        self._cache_file = _CheckedFile(
            self.cache_path, self._base, self._impl.locator.get_source_stamp()
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the code for a signature; None if there is none, or if it is damaged."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:
            for path in Path(self.cache_path).glob(f"{glob.escape(self._base)}.*"):
                with suppress(OSError):
                    path.unlink()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the code for a signature, if there is room."""
        with suppress(Exception):
            super().save_overload(sig, data)


class _CheckedFile(IndexDataCacheFile):
    """The index and the files of one function; a checksum follows each pickled object, which pickle ignores."""

    def _dump(self, obj: Any) -> bytes:
        content: bytes = super()._dump(obj)
        return content + _sum(content)

    def _load_data(self, name: str) -> Any:
        _check(Path(self._data_path(name)).read_bytes())
        return super()._load_data(name)

    def _load_index(self) -> Any:
        with suppress(FileNotFoundError), Path(self._index_path).open("rb") as file:
            pickle.load(file)  # numba's version comes first
            _check(file.read())
        return super()._load_index()


def _sum(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=_SUM_BYTES).digest()


def _check(content: bytes) -> None:
    if content[-_SUM_BYTES:] != _sum(content[:-_SUM_BYTES]):
        raise ValueError("damaged")
