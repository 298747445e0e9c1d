"""The places of observations in their layout, compiled: see observations.py for the layout itself."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array, Indices
from sucre_bench.imaging.once import locked
from sucre_bench.machine.compile_loops import compiled
from sucre_bench.machine.cores import usable_cores

# Observations that are worth a thread.
_MANY = 200_000


class Slots:
    """Where the observations of each pixel go, view after view.

    n_pixels: of the target; seen: the pixels (M,) of each view, each at most once in a view.
    pixels, counts, starts: as `Observations` has them.
    """

    def __init__(self, n_pixels: int, seen: Iterable[Indices]) -> None:
        counts = np.zeros(n_pixels, dtype=np.int32)
        for pixels in seen:
            compiled(_count)(locked(pixels), counts)
        self.pixels = np.empty(int(np.count_nonzero(counts)), dtype=np.int64)
        self._place = np.empty(n_pixels, dtype=np.int32)  # of each pixel in that order
        sizes = compiled(_order)(counts, self.pixels, self._place)
        self.counts = counts[self.pixels]
        self.starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        self._filled = np.zeros(n_pixels, dtype=np.int32)  # the next slot of each pixel

    def __len__(self) -> int:
        """The number of observations."""
        return int(self.starts[-1])

    def fill(
        self,
        pixels: Indices,
        values: Array,
        colours: npt.NDArray[Any],
        out: Array,
        colour: Array,
        with_places: bool = True,
    ) -> Indices:
        """Store the observations of the next view, and return their places (M,) int64; none without `with_places`.

        pixels: (M,) of the view; values: (M,), stored in out (N,); colours: (M, 3), stored in colour (3, N).
        """
        at = np.empty(len(pixels) if with_places else 0, dtype=np.int64)
        into = (self.starts, self._place, self._filled, at, np.asarray(out), np.asarray(colour))
        given = (locked(pixels), locked(values), locked(np.ascontiguousarray(colours)))

        def of(start: int) -> None:
            compiled(_fill)(*given, *into, start, min(start + step, len(pixels)))

        step = max(_MANY, -(-len(pixels) // usable_cores()))
        starts = range(0, len(pixels), step)
        if len(starts) == 1:
            of(0)
        elif len(starts) > 1:  # a view's pixels differ, so no two threads write to one place
            with ThreadPoolExecutor(len(starts)) as pool:
                list(pool.map(of, starts))
        return at


def _count(pixels: Indices, counts: Indices) -> None:
    for i in range(len(pixels)):
        counts[pixels[i]] += 1


def _order(counts: Indices, pixels: Indices, place: Indices) -> Indices:
    """Sort pixels by falling count, equal counts by rising index; return how many have more than k, (S,)."""
    n_with = np.zeros(counts.max() + 1 if len(counts) else 1, np.int64)
    for pixel in range(len(counts)):
        n_with[counts[pixel]] += 1
    n_more = np.zeros(len(n_with), np.int64)
    for count in range(len(n_with) - 2, -1, -1):
        n_more[count] = n_more[count + 1] + n_with[count + 1]
    at = n_more.copy()
    for pixel in range(len(counts)):
        count = counts[pixel]
        if count:
            pixels[at[count]] = pixel
            place[pixel] = at[count]
            at[count] += 1
    return n_more[: len(n_more) - 1]


def _fill(
    pixels: Indices,
    values: Array,
    colours: npt.NDArray[Any],
    starts: Indices,
    place: Indices,
    filled: Indices,
    at: Indices,
    out: Array,
    colour: npt.NDArray[Any],
    first: int,
    last: int,
) -> None:
    for i in range(first, last):
        pixel = pixels[i]
        k = starts[filled[pixel]] + place[pixel]
        filled[pixel] += 1
        if len(at):
            at[i] = k
        out[k] = values[i]
        colour[0, k], colour[1, k], colour[2, k] = colours[i, 0], colours[i, 1], colours[i, 2]
