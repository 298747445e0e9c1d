"""Digests of source files, stored in the user's cache, because parsing 200 files takes longer than many commands."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from sucre_bench.errors import OutputError
from sucre_bench.machine.files import write_atomically

# A file that changed less than so many seconds ago may change again without a new time stamp.
_SETTLED_S = 2.0


class KeptDigests:
    """Digests by file, kept as JSON. A cache that cannot be read or written is done without.

    path: of the cache; rule: names what `compute` does; digests of another rule are not taken.
    """

    def __init__(self, path: Path, rule: str) -> None:
        self._path, self._rule = path, rule
        self._known = _read(path, rule)
        self._is_new = False

    def of(self, file: Path, compute: Callable[[Path], list[str]]) -> list[str]:
        """Return `compute(file)`, from the cache if the file's size and time of change are as they were."""
        state = file.stat()
        stamp = [state.st_size, state.st_mtime_ns]
        found = self._known.get(str(file))
        if found is not None and found[0] == stamp:
            return [str(digest) for digest in found[1]]
        digests = compute(file)
        if time.time() - state.st_mtime > _SETTLED_S:
            self._known[str(file)] = [stamp, digests]
            self._is_new = True
        return digests

    def write(self) -> None:
        """Write the cache if it has anything new. Files that no longer exist are left out."""
        if self._is_new:
            kept = {file: entry for file, entry in self._known.items() if Path(file).exists()}
            with suppress(OutputError):
                write_atomically(self._path, json.dumps({"rule": self._rule, "files": kept}).encode())


def _read(path: Path, rule: str) -> dict[str, Any]:
    with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
        content = json.loads(path.read_bytes())
        return dict(content["files"].items()) if content["rule"] == rule else {}
    return {}
