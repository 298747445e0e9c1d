"""Writes files atomically: a reader sees the old content or the new, never a part."""

from __future__ import annotations

import errno
import os
import tempfile
from pathlib import Path

from sucre_bench.errors import OutputError

__all__ = ["write_atomically"]


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file atomically, with its folders.

    Raises OutputError if the disk is full or the place cannot be written to.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=".writing-", delete=False) as file:
            try:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
                os.fchmod(file.fileno(), 0o644)
                Path(file.name).replace(path)
            except BaseException:
                Path(file.name).unlink(missing_ok=True)
                raise
    except OSError as fault:
        raise _not_writable(path, fault) from fault


def _not_writable(path: Path, fault: OSError) -> OutputError:
    if fault.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return OutputError(f"{path}: the disk is full; free some space and give the same command again")
    return OutputError(f"{path}: cannot be written ({fault.strerror}); choose another place")
