"""Digests of source files, kept in the user's cache: parsing some 200 files takes longer than many a command."""

from __future__ import annotations

import atexit
import functools
import json
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from sucre_bench.errors import OutputError
from sucre_bench.machine.files import write_atomically

__all__ = ["kept_digests"]

# A file that changed less than so many seconds ago may change again without a new time stamp.
_SETTLED_S = 2.0


def kept_digests(file: Path, rule: str, compute: Callable[[Path], list[str]]) -> list[str]:
    """Return `compute(file)`, from the cache if the file's size and time of change are as they were.

    rule: names what `compute` does; results of another rule are not taken. A cache that cannot be read or written is
    done without.
    """
    state = file.stat()
    stamp = [rule, state.st_size, state.st_mtime_ns]
    known = _cache()
    found = known.get(str(file))
    if found is not None and found[0] == stamp:
        return [str(digest) for digest in found[1]]
    digests = compute(file)
    if time.time() - state.st_mtime > _SETTLED_S:
        if _NEW not in known:
            known[_NEW] = True
            atexit.register(_write)
        known[str(file)] = [stamp, digests]
    return digests


_NEW = ""  # the key that says whether there is anything to write


@functools.cache
def _cache() -> dict[str, Any]:
    with suppress(OSError, ValueError):
        content = json.loads(_path().read_bytes())
        return content if isinstance(content, dict) else {}
    return {}


def _path() -> Path:
    from platformdirs import user_cache_path

    return user_cache_path("sucre_bench", appauthor=False) / "code_digests.json"


def _write() -> None:
    kept = {file: entry for file, entry in _cache().items() if file != _NEW and Path(file).exists()}
    with suppress(OutputError):
        write_atomically(_path(), json.dumps(kept).encode())
