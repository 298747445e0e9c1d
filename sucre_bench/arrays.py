"""Types of arrays and tables, and questions about arrays that many rooms ask.

`once` computes only once what several metrics, or variants of one, need of a picture.
"""

import functools
import weakref
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.floating[Any]]
Indices = npt.NDArray[np.integer[Any]]
Mask = npt.NDArray[np.bool_]
Picture = npt.NDArray[np.uint8]
AnyArray = npt.NDArray[Any]  # of numbers of any type
Size = tuple[int, int]  # (width, height) of an image, pixels

CHANNELS = ("red", "green", "blue")  # of the last axis of images

# pandas takes half a second to import. Functions that need it import it; annotations name its types from here.
if TYPE_CHECKING:
    from pandas import DataFrame as DataFrame, Series as Series
else:
    DataFrame = Series = Any


def evenly(count: int, most: int) -> list[int]:
    """Return the places of at most so many of `count` things, in order; all of them where they are no more."""
    return (
        np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int)).tolist()
        if count
        else []
    )


def coloured(image: npt.NDArray[Any]) -> Mask:
    """Return the pixels (H, W) of an image (H, W, 3) that have a colour: all three channels are finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        if np.isfinite(image.sum()):
            # one quick pass that most images end at: a sum is finite if all values are
            return np.ones(image.shape[:-1], dtype=bool)
    finite = np.isfinite(image[..., 0])
    finite &= np.isfinite(image[..., 1])
    finite &= np.isfinite(image[..., 2])
    return np.asarray(finite)


P = ParamSpec("P")
T = TypeVar("T")
Key = tuple[Any, ...]

# Results by the array's id. The reference removes them when the array is freed, so an id is never met again.
_results: dict[int, tuple[weakref.ref[npt.NDArray[Any]], dict[Key, Any]]] = {}


def once(
    work: Callable[Concatenate[npt.NDArray[Any], P], T],
) -> Callable[Concatenate[npt.NDArray[Any], P], T]:
    """Decorate a function of an array so that it runs once while that array lives.

    Only read-only arrays are remembered (a score's `shown`, a view's planes): a writable one may change between calls.
    Further arguments must be hashable. Callers share the result, so it must be left as it is.
    """

    @functools.wraps(work)
    def remembered(array: npt.NDArray[Any], /, *args: P.args, **kwargs: P.kwargs) -> T:
        if array.flags.writeable or not array.nbytes:
            return work(array, *args, **kwargs)
        place = id(array)
        if place not in _results:
            _results[place] = weakref.ref(array, lambda _: _results.pop(place, None)), {}
        found = _results[place][1]
        key = (work, *args, *sorted(kwargs.items()))
        if key not in found:
            found[key] = work(array, *args, **kwargs)
        result: T = found[key]
        return result

    return remembered


def locked(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return a read-only view of an array, or the array itself where it is read-only already.

    What is computed of it is shared, see `once`; and compiled loops meet one type in place of two.
    """
    if not array.flags.writeable:
        return array
    view = array.view()
    view.setflags(write=False)
    return view


# `coloured` of an image, which most metrics ask for.
coloured_pixels = once(coloured)
