"""Some of many, evenly chosen: the first, the last, and others at equal steps between."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["Array", "Mask", "Picture", "evenly"]


def evenly(count: int, most: int) -> list[int]:
    """Return the places of at most so many of `count` things, in order; all of them where they are no more."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist() if count else []


Picture = npt.NDArray[np.uint8]


Array = npt.NDArray[np.floating[Any]]


Mask = npt.NDArray[np.bool_]
