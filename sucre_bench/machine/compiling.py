"""Compiles the loops of this package when they are first called."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

__all__ = ["compiled"]


@functools.cache
def compiled(loop: Callable[..., Any]) -> Callable[..., Any]:
    """Return a module's function compiled by numba, imported here and not before; the result is cached on disk.

    The function uses no threads: its callers are threads, and numba's default threading layer allows one caller only.
    """
    import numba

    made: Callable[..., Any] = numba.njit(nogil=True, cache=True, error_model="numpy")(loop)
    return made
