"""Statistics of many numbers with few different values: each value once, with its count.

An 8-bit picture of 12 megapixels has about a million colours, 256 levels and 511 differences of two levels. Sums over
these give exactly what sums over all pixels give, and percentiles need no sort of the pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array

Counts = npt.NDArray[np.integer[Any]]


@dataclass(frozen=True, slots=True, eq=False)
class ValueCounts:
    """Numbers in ascending order. values: (V,) float64, ascending; upto: (V,) how many numbers are no greater."""

    values: Array
    upto: Counts

    @classmethod
    def of(cls, values: npt.NDArray[Any], counts: Counts) -> ValueCounts:
        """Count numbers (V,), in any order, of which each occurs counts (V,) times. V > 0."""
        order = np.argsort(values)
        return cls(values[order].astype(np.float64), np.cumsum(counts[order], dtype=np.int64))

    @property
    def size(self) -> int:
        """How many numbers there are."""
        return int(self.upto[-1])

    def at(self, rank: npt.NDArray[Any] | int) -> Array:
        """Return the numbers at places `rank` (0 for the least) of the ascending order."""
        return np.asarray(self.values[np.searchsorted(self.upto, rank, side="right")])

    def percentile(self, q: float) -> float:
        """Return the percentile q, 0 to 100, between two neighbours as `numpy.percentile` has it."""
        place = q / 100 * (self.size - 1)
        below = int(place)
        low, high = self.at(np.array([below, min(below + 1, self.size - 1)]))
        return float(low + (high - low) * (place - below))

    def between(self, first: int, last: int) -> Counts:
        """Return how often each value occurs among the places first <= rank < last (V,)."""
        return np.diff(self.upto.clip(first, last), prepend=first)

    def mean(self, first: int = 0, last: int | None = None) -> float:
        """Return the mean of the places first <= rank < last, default all."""
        last = self.size if last is None else last
        return float((self.values * self.between(first, last)).sum() / (last - first))

    def mean_square(self, about: float, first: int = 0, last: int | None = None) -> float:
        """Return the mean squared distance of the places first <= rank < last from `about`."""
        last = self.size if last is None else last
        return float(((self.values - about) ** 2 * self.between(first, last)).sum() / (last - first))
