"""The cells of one column: means, paired differences between methods, ranks, ties, wins, effects."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.compare.bootstrap import Units, differences, mean_intervals
from sucre_bench.compare.leads import changes, leads
from sucre_bench.compare.means import means
from sucre_bench.compare.model import EQUAL, NO_DIFFERENCE, Cell, Column, ColumnScores, Difference, may_be_chance
from sucre_bench.compare.numbers import standard_deviation


def cells(column: Column, measured: ColumnScores, apart: Collection[str] = ()) -> list[Cell]:
    """Return the cell of each method of `measured`, compared with the best.

    apart: methods that are not compared, unless all are: their cells have no place.
    """
    size = _size(measured.views)  # scores that cancel out leave rounding errors, far below their size
    mean, low, high = (_known(one, size) for one in (means(measured.views), *_interval(column, measured)))
    made = [
        Cell(float(mean[m]), float(measured.std[m]), float(low[m]), float(high[m]), int(measured.holes[m]))
        for m in range(len(mean))
    ]
    if column.better == "none" or not column.competes:
        return made
    rivals = [m for m, name in enumerate(measured.methods) if name not in apart] or [*range(len(made))]
    ranked = _ranked(column, measured.of(rivals), [made[m] for m in rivals])
    for m, cell in zip(rivals, ranked, strict=True):
        made[m] = cell
    return made


def _ranked(column: Column, measured: ColumnScores, made: Sequence[Cell]) -> list[Cell]:
    views, sign = measured.views, _sign(column)
    size = _size(views)
    pairs = _Pairs.of(means(views) * sign, size, measured.independent)
    places, ranks, wins = pairs.places(), pairs.ranks(), _best_in(views * sign, size)
    best = int(np.argmin(places))
    behind = [pairs.difference(best, m) for m in range(len(made))]
    return [
        replace(
            cell,
            place=int(places[m]),
            rank=int(ranks[m]) if column.ranked else int(places[m]),
            tie=bool(column.ranked and places[m] > 1 and may_be_chance(behind[m])),
            behind=behind[m],
            wins=float(wins[m]),
            effect=_effect(_less(views[:, best], views[:, m], size[[best, m]].max()) * sign) if m != best else np.nan,
        )
        for m, cell in enumerate(made)
    ]


def against(column: Column, measured: ColumnScores, cells: Sequence[Cell], baseline: int) -> list[Cell]:
    """Return the cells with change, wins and effect against the baseline, the method of that number in `measured`.

    The methods of `measured` are judged together.
    """
    if column.better == "none":
        return list(cells)
    views, sign = measured.views, _sign(column)
    mean, size = means(views), _size(views)
    size = np.maximum(size, size[baseline])
    half = np.full_like(mean, np.nan)
    if measured.independent is not None:
        half = changes(measured.independent, baseline)
    gap = _less(mean, mean[baseline], size)
    lead = -_less(views, views[:, [baseline]], size) * sign
    made = []
    for m, cell in enumerate(cells):
        if m == baseline:
            made.append(replace(cell, change=NO_DIFFERENCE, wins=np.nan, effect=np.nan))
            continue
        change = _difference(gap[m], half[m], size[m])
        wins = float((lead[:, m] > 0).sum() + 0.5 * (lead[:, m] == 0).sum())
        made.append(replace(cell, change=change, wins=wins, effect=_effect(lead[:, m])))
    return made


def _sign(column: Column) -> int:
    """What turns scores into numbers of which the best is the smallest."""
    return -1 if column.better == "higher" else 1


def _interval(column: Column, measured: ColumnScores) -> tuple[Array, Array]:
    """The 95 % interval of each mean, within the range of the metric: with few views it would leave that."""
    if measured.independent is None:
        return (np.full(len(measured.methods), np.nan),) * 2
    low, high = mean_intervals(measured.independent)
    return np.maximum(low, column.range[0]), np.minimum(high, column.range[1])


def _size(views: Array) -> Array:
    """(M,) how large a method's scores are, their mean without signs; 0 if one is not finite. views: (V, M)."""
    size = np.abs(views).mean(axis=0)
    return np.where(np.isfinite(size), size, 0.0)


def _known(differences: Array | float, size: Array | float) -> Array:
    """Differences of scores of a size, 0 in the place of those that are nothing beside it."""
    return np.where(np.abs(differences) <= EQUAL * size, 0.0, differences)


def _less(values: Array, others: Array | float, size: Array | float) -> Array:
    """Differences of scores of a size; 0 between equals, be they infinite."""
    with np.errstate(invalid="ignore"):
        return np.where(values == others, 0.0, _known(values - others, size))


def _difference(gap: float, half: float, size: float) -> Difference:
    ends = _known(np.array([gap, gap - half, gap + half]), size)
    return float(ends[0]), float(ends[1]), float(ends[2])


@dataclass(frozen=True)
class _Pairs:
    """Pairs of methods [i, j]; those of the best are judged by its leads.

    gap: (M, M), how far method j is behind method i; half: (M, M), half of the interval, NaN without one; size: (M, M),
    of the larger scores.
    """

    gap: Array
    half: Array
    size: Array

    @classmethod
    def of(cls, worse: Array, size: Array, independent: Units | None) -> _Pairs:
        """worse: (M,) means, the best the smallest; size: (M,) of the methods' scores."""
        sizes = np.maximum(size, size[:, None])
        gap, half = _less(worse, worse[:, None], sizes), np.full_like(sizes, np.nan)
        if independent is not None:
            np.fill_diagonal(half, np.where(np.isfinite(worse), 0.0, np.nan))
            if pairs := list(combinations(range(len(worse)), 2)):
                i, j = np.transpose(pairs)
                half[i, j] = half[j, i] = differences(independent, pairs)
                best = int(np.argmin((gap > 0).sum(axis=0)))
                others = np.arange(len(worse)) != best
                half[best, others] = half[others, best] = leads(independent, best)[others]
        return cls(gap, half, sizes)

    def difference(self, i: int, j: int) -> Difference:
        """How far method j is behind method i, with its interval."""
        return _difference(self.gap[i, j], self.half[i, j], self.size[i, j])

    def places(self) -> Array:
        """1 + how many methods have the better mean."""
        return np.asarray(1 + (self.gap > 0).sum(axis=0))

    def ranks(self) -> Array:
        """1 + how many methods are better by more than chance; by their mean where chance is not known."""
        methods = range(len(self.gap))
        surely = [[self.gap[i, j] > 0 and not may_be_chance(self.difference(i, j)) for j in methods] for i in methods]
        return np.asarray(1 + np.sum(surely, axis=0))


def _best_in(worse: Array, size: Array) -> Array:
    """In how many views each method is the best; equal methods share a view. worse: (V, M), the best the smallest."""
    best = np.maximum(size, size[worse.argmin(axis=1)][:, None])
    leads = _less(worse, worse.min(axis=1, keepdims=True), best) == 0
    return np.asarray((leads / leads.sum(axis=1, keepdims=True)).sum(axis=0))


def _effect(gain: Array) -> float:
    """The mean gain over a reference, in standard deviations of the gain. gain: (V,); positive = better."""
    if len(gain) < 2 or not np.isfinite(gain).all():
        return np.nan
    spread = float(standard_deviation(gain))
    return float(gain.mean() / spread) if spread > EQUAL * np.abs(gain).mean() else np.nan
