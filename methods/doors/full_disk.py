"""Names a full disk of temporary files, also where a program that failed was what found it full."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from errno import ENOSPC
from pathlib import Path

from sucre_bench.errors import DiskFullError
from sucre_bench.scene import View

_REMEDY = "free some space there, or name a folder on another disk in TMPDIR"
_IMAGE_BYTES = 3  # of a pixel, in 8 bits without compression


@contextmanager
def full_disk_named() -> Iterator[None]:
    """Inside, the error of a full disk names the folder of temporary files, and how to have another one."""
    try:
        yield
    except DiskFullError as fault:
        raise DiskFullError(f"{tempfile.gettempdir()}: the disk is full; {_REMEDY}") from fault


def want_of_room(place: Path, view: View, said: str) -> str:
    """Return the remedy if a program failed on a full disk, else "".

    place: the program's folder; said: what it printed. The disk counts as full if the program says so, or if a
    restored image might not fit.
    """
    free = shutil.disk_usage(place).free
    is_full = os.strerror(ENOSPC) in said or free < _IMAGE_BYTES * view.rgb[..., 0].size
    return f"{place.parent} has {free / 1e6:.1f} MB free; {_REMEDY}" if is_full else ""
