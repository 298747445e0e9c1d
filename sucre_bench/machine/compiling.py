"""Compiling the loops of this package, when they are first called."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

__all__ = ["compiled"]


@functools.cache
def compiled(loop: Callable[..., Any]) -> Callable[..., Any]:
    """Return a module's function compiled by numba, which is not imported before; the compiler's work is kept on disk.

    No threads of its own: callers are threads already, which numba's default layer does not stand.
    """
    import numba

    made: Callable[..., Any] = numba.njit(nogil=True, cache=True, error_model="numpy")(loop)
    return made
