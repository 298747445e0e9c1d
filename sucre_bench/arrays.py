"""Types of arrays and tables, and questions about arrays that many rooms ask."""

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from sucre_bench.errors import InputError

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


# Restored images may exceed 1, in places by far; their typical values stay below this. Those of 0 to 255 do not.
_MOST_TYPICAL = 16.0

# Rows and columns of an image that tell its range.
_LOOKED_AT = 48


def check_intensities(image: object, place: str) -> None:
    """Raise InputError for an image of 0 to 255 or 0 to 65535, by its type or a sample of its values; place: its name.

    Intensities are floats with 1 for white. What is no NumPy array is not looked at.
    """
    if not isinstance(image, np.ndarray) or image.ndim < 2 or image.dtype.kind not in "iuf":
        return
    white = np.iinfo(np.uint16).max
    sample = image[:: max(1, image.shape[0] // _LOOKED_AT), :: max(1, image.shape[1] // _LOOKED_AT)]
    sample = sample[np.isfinite(sample)]
    top = sample.max(initial=0)
    if image.dtype.kind in "iu":
        fault = f"is {image.dtype}"
    elif _MOST_TYPICAL < top <= white and (np.median(sample) > _MOST_TYPICAL or (sample == np.rint(sample)).all()):
        fault = f"has values up to {top:g}"
    else:
        return
    remedy = f"divide by {255 if top <= 255 else white}: intensities are floats with 1 for white"
    raise InputError(fault, place, remedy)


def coloured(image: npt.NDArray[Any]) -> Mask:
    """Return the pixels (H, W) of an image (H, W, 3) that have a colour: all three channels are finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        if np.isfinite(image.sum()):  # one quick pass that most images end at: a sum is finite if all values are
            return np.ones(image.shape[:-1], dtype=bool)
    finite = np.isfinite(image[..., 0])
    finite &= np.isfinite(image[..., 1])
    finite &= np.isfinite(image[..., 2])
    return np.asarray(finite)
