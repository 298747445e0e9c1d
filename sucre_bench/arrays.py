"""Types of arrays and tables, and questions about arrays that many rooms ask."""

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.floating[Any]]
Indices = npt.NDArray[np.integer[Any]]
Mask = npt.NDArray[np.bool_]
Picture = npt.NDArray[np.uint8]

# pandas takes half a second to import. Functions that need it import it; annotations name its types from here.
if TYPE_CHECKING:
    from pandas import DataFrame as DataFrame
    from pandas import Series as Series
else:
    DataFrame = Series = Any


def evenly(count: int, most: int) -> list[int]:
    """Return the places of at most so many of `count` things, in order; all of them where they are no more."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist() if count else []


def coloured(image: npt.NDArray[Any]) -> Mask:
    """Return the pixels (H, W) of an image (H, W, 3) that have a colour: all three channels are finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        if np.isfinite(image.sum()):  # one quick pass that most images end at: a sum is finite if all values are
            return np.ones(image.shape[:-1], dtype=bool)
    finite = np.isfinite(image[..., 0])
    finite &= np.isfinite(image[..., 1])
    finite &= np.isfinite(image[..., 2])
    return np.asarray(finite)
