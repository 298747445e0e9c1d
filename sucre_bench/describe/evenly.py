"""Some of many, evenly chosen: the first, the last, and others at equal steps between."""

from __future__ import annotations

import numpy as np

__all__ = ["evenly"]


def evenly(count: int, most: int) -> list[int]:
    """Return the places of at most so many of `count` things, in order; all of them where they are no more."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist() if count else []
