"""Exact statistics of many numbers without a sort: of each channel of an image, and of few different values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import AnyArray, Array, Mask, locked
from sucre_bench.machine.compute import compiled

_BINS = 1 << 16  # floats that share their upper 16 bits differ by less than 1 %


def channel_percentiles(
    pixels: AnyArray, percentiles: Sequence[float], valid: Mask | None = None
) -> Array:
    """Return percentiles (Q, 3) float64 of each channel of pixels (..., 3), as `numpy.percentile` gives them.

    percentiles: from 0 to 100; valid: (...) which pixels count, at least one and all finite; default all.
    """
    n = int(np.prod(pixels.shape[:-1]) if valid is None else np.count_nonzero(valid))
    place = np.asarray(percentiles, dtype=np.float64) / 100 * (n - 1)
    below = np.floor(place).astype(np.intp)
    above = np.minimum(below + 1, n - 1)
    ranks = np.unique([below, above])
    if pixels.dtype == np.float32:
        flat = np.ascontiguousarray(pixels).reshape(-1, pixels.shape[-1])
        mask = np.ones(len(flat), np.bool_) if valid is None else valid.ravel()
        found = _at_ranks(flat.view(np.uint32), mask, ranks)  # (R, 3)
    else:
        counted = (pixels if valid is None else pixels[valid]).reshape(-1, pixels.shape[-1])
        found = np.partition(counted, ranks, axis=0)[ranks]
    low, high = (
        found[np.searchsorted(ranks, side)].astype(np.float64) for side in (below, above)
    )
    return np.asarray(low + (high - low) * (place - below)[:, None])


def _at_ranks(
    bits: npt.NDArray[np.uint32], valid: Mask, ranks: npt.NDArray[np.intp]
) -> npt.NDArray[np.float32]:
    """Return the values at ranks (R,), 0 the least, of each channel of float32 pixels (P, C), given as their bits.

    Pixels are counted by the upper 16 bits of a key that is ordered as floats are. Only those that share them with a
    value that is looked for are sorted.
    """
    counts = np.zeros((bits.shape[1], _BINS), np.int64)
    compiled(_count)(locked(bits), locked(valid), counts)
    found = []
    for channel, of_bin in enumerate(counts):
        upto = np.cumsum(of_bin)
        bins = np.unique(np.searchsorted(upto, ranks, side="right"))
        wanted = np.zeros(_BINS, np.bool_)
        wanted[bins] = True
        keys = np.empty(of_bin[bins].sum(), np.uint32)
        compiled(_collect)(locked(bits), locked(valid), channel, wanted, keys)
        keys.sort()
        skipped = np.cumsum(np.where(wanted, 0, of_bin))[
            np.searchsorted(upto, ranks, side="right")
        ]
        key = keys[ranks - skipped]
        found.append(np.where(key >> 31, key ^ np.uint32(1 << 31), ~key).view(np.float32))
    return np.stack(found, axis=-1)


def _count(bits: npt.NDArray[np.uint32], valid: Mask, counts: npt.NDArray[np.int64]) -> None:
    for pixel in range(bits.shape[0]):
        if valid[pixel]:
            for channel in range(bits.shape[1]):
                value = bits[pixel, channel]
                key = np.uint32(~value if value >> 31 else value | np.uint32(1 << 31))
                counts[channel, key >> 16] += 1


def _collect(
    bits: npt.NDArray[np.uint32],
    valid: Mask,
    channel: int,
    wanted: Mask,
    keys: npt.NDArray[np.uint32],
) -> None:
    n = 0
    for pixel in range(bits.shape[0]):
        value = bits[pixel, channel]
        key = np.uint32(~value if value >> 31 else value | np.uint32(1 << 31))
        if wanted[key >> 16] and valid[pixel]:
            keys[n] = key
            n += 1


Counts = npt.NDArray[np.integer[Any]]


@dataclass(frozen=True, slots=True, eq=False)
class ValueCounts:
    """Numbers in ascending order."""

    values: Array
    """Ascending, (V,) float64."""

    upto: Counts
    """How many numbers are no greater, (V,)."""

    @classmethod
    def of(cls, values: AnyArray, counts: Counts) -> ValueCounts:
        """Count numbers (V,), in any order, of which each occurs counts (V,) times. V > 0."""
        order = np.argsort(values)
        return cls(values[order].astype(np.float64), np.cumsum(counts[order], dtype=np.int64))

    @property
    def size(self) -> int:
        """How many numbers there are."""
        return int(self.upto[-1])

    def at(self, rank: AnyArray | int) -> Array:
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
        return float(
            ((self.values - about) ** 2 * self.between(first, last)).sum() / (last - first)
        )
