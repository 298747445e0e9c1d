"""The numbers of one column: means, paired differences of all methods, and what they say of better and worse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.compare.bootstrap import interval
from sucre_bench.compare.model import Cell, Column, Difference

__all__ = ["cells"]

_EQUAL = 1e-12  # scores that differ by rounding only
_NONE: Difference = (np.nan, np.nan, np.nan)


def cells(
    column: Column, views: Array, std: Array, resampled: Array | None, holes: Array, baseline: int | None = None
) -> list[Cell]:
    """Return the cell of each method.

    views: (V, M) a row a view, without holes; std: (M,) over units; resampled: (M, R) means, None where there are no
    intervals; holes: (M,) counts; baseline: which method to compare with.
    """
    n = column.n_scenes if column.n_scenes > 1 else column.n_views
    with np.errstate(invalid="ignore"):  # infinity minus infinity
        mean = views.mean(axis=0)
        low, high = (np.full_like(mean, np.nan),) * 2 if resampled is None else interval(resampled, mean, n)
        low, high = np.maximum(low, column.range[0]), np.minimum(high, column.range[1])  # of few views it goes beyond
        sign = -1 if column.better == "higher" else 1
        pairs = _Pairs.of(mean * sign, None if resampled is None else resampled * sign, n)
    places, ranks = pairs.places(), pairs.ranks()
    best = int(np.argmin(places))
    other = best if baseline is None else baseline
    wins = _wins(views * sign, baseline)
    made: list[Cell] = []
    for m, place in enumerate(places):
        about = (float(mean[m]), float(std[m]), float(low[m]), float(high[m]))
        if column.better == "none":
            made.append(Cell(*about, 0, 0, False, _NONE, np.nan, np.nan, int(holes[m]), _NONE))
            continue
        made.append(
            Cell(
                *about,
                place=int(place),
                rank=int(ranks[m]) if column.ranked else int(place),
                tie=bool(column.ranked and place > 1 and pairs.low[best, m] <= _EQUAL),
                behind=pairs.behind(best, m),
                wins=float(wins[m]),
                effect=_effect((views[:, other], views[:, m]), sign) if m != other else np.nan,
                holes=int(holes[m]),
                change=_NONE if baseline is None or m == baseline else pairs.change(baseline, m, sign),
            )
        )
    return made


@dataclass(frozen=True)
class _Pairs:
    """How far method j is behind method i, and the 95 % interval of that: each (M, M), indexed [i, j]."""

    gap: Array
    low: Array
    high: Array

    @classmethod
    def of(cls, worse: Array, resampled: Array | None, n: int) -> _Pairs:
        """worse: (M,) means, the best the smallest; resampled: (M, R)."""
        gap = worse - worse[:, None]
        low, high = np.full_like(gap, np.nan), np.full_like(gap, np.nan)
        if resampled is not None:
            for i, own in enumerate(resampled):
                low[i, i:], high[i, i:] = interval(resampled[i:] - own, gap[i, i:], n)
                low[i:, i], high[i:, i] = -high[i, i:], -low[i, i:]
        return cls(gap, low, high)

    def places(self) -> Array:
        """1 + how many methods have the better mean."""
        return np.asarray(1 + (self.gap > _EQUAL).sum(axis=0))

    def ranks(self) -> Array:
        """1 + how many methods are better by more than chance; by their mean where chance is not known."""
        surely = np.where(np.isnan(self.low), self.gap, self.low) > _EQUAL
        return np.asarray(1 + surely.sum(axis=0))

    def behind(self, i: int, j: int) -> Difference:
        return float(self.gap[i, j]), float(self.low[i, j]), float(self.high[i, j])

    def change(self, i: int, j: int, sign: int) -> Difference:
        """The score of j less that of i: what is behind is lower where higher is better."""
        gap, low, high = self.behind(i, j)
        return (gap, low, high) if sign > 0 else (-gap, -high, -low)


def _wins(worse: Array, baseline: int | None) -> Array:
    """In how many views each method is the best, or beats the baseline. worse: (V, M), the best the smallest."""
    if baseline is None:
        leads = worse <= worse.min(axis=1, keepdims=True) + _EQUAL
        return np.asarray((leads / leads.sum(axis=1, keepdims=True)).sum(axis=0))
    of_it = worse[:, [baseline]]
    lead = -_less(worse, of_it)
    wins = np.asarray(((lead > _EQUAL) + 0.5 * (np.abs(lead) <= _EQUAL)).sum(axis=0))
    wins[baseline] = np.nan
    return wins


def _less(values: Array, other: Array) -> Array:
    """A difference in which equal infinities are equal."""
    with np.errstate(invalid="ignore"):
        return np.where(values == other, 0.0, values - other)


def _effect(pair: tuple[Array, Array], sign: int) -> float:
    """The mean of the differences between two methods' views (V,), in their standard deviations."""
    gain = _less(*pair) * sign
    if len(gain) < 2 or not np.isfinite(gain).all():
        return np.nan
    spread = gain.std(ddof=1)
    return float(gain.mean() / spread) if spread > _EQUAL else np.nan
