"""The cells of one column: means, paired differences between methods, ranks, ties, wins, effects."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.compare.bootstrap import Units, differences, mean_intervals
from sucre_bench.compare.model import NO_DIFFERENCE, Cell, Column, Difference, Measured

__all__ = ["against", "cells"]

_EQUAL = 1e-12  # scores that differ by rounding only


def cells(column: Column, measured: Measured, apart: Collection[str] = ()) -> list[Cell]:
    """Return the cell of each method of `measured`, compared with the best.

    apart: methods that are not compared, unless all are: their cells have no place.
    """
    mean = _means(measured.views)
    low, high = _interval(column, measured)
    made = [
        Cell(float(mean[m]), float(measured.std[m]), float(low[m]), float(high[m]), int(measured.holes[m]))
        for m in range(len(mean))
    ]
    if column.better == "none":
        return made
    rivals = [m for m, name in enumerate(measured.methods) if name not in apart] or [*range(len(made))]
    ranked = _ranked(column, measured.of(rivals), [made[m] for m in rivals])
    for m, cell in zip(rivals, ranked, strict=True):
        made[m] = cell
    return made


def _ranked(column: Column, measured: Measured, made: Sequence[Cell]) -> list[Cell]:
    views, sign = measured.views, _sign(column)
    mean = _means(views)
    pairs = _Pairs.of(mean * sign, measured.independent)
    places, ranks, wins = pairs.places(), pairs.ranks(), _best_in(views * sign)
    best = int(np.argmin(places))
    return [
        replace(
            cell,
            place=int(places[m]),
            rank=int(ranks[m]) if column.ranked else int(places[m]),
            tie=bool(column.ranked and places[m] > 1 and pairs.gap[best, m] - pairs.half[best, m] <= _EQUAL),
            behind=_difference(pairs.gap[best, m], pairs.half[best, m]),
            wins=float(wins[m]),
            effect=_effect(views[:, best], views[:, m], sign) if m != best else np.nan,
        )
        for m, cell in enumerate(made)
    ]


def against(column: Column, measured: Measured, cells: Sequence[Cell], baseline: int) -> list[Cell]:
    """Return the cells with change, wins and effect against the baseline, the method of that number in `measured`.

    The intervals of the changes hold all at once for the methods of `measured`.
    """
    if column.better == "none":
        return list(cells)
    views, sign = measured.views, _sign(column)
    mean = _means(views)
    with np.errstate(invalid="ignore"):
        gap, half = mean - mean[baseline], np.full_like(mean, np.nan)
    others = [m for m in range(len(cells)) if m != baseline]
    if measured.independent is not None and others:
        half[others] = differences(measured.independent, [(baseline, m) for m in others])
    wins = _beats(views * sign, baseline)
    made = []
    for m, cell in enumerate(cells):
        change = NO_DIFFERENCE if m == baseline else _difference(gap[m], half[m])
        effect = np.nan if m == baseline else _effect(views[:, baseline], views[:, m], sign)
        made.append(replace(cell, change=change, wins=float(wins[m]), effect=effect))
    return made


def _sign(column: Column) -> int:
    """What turns scores into numbers of which the best is the smallest."""
    return -1 if column.better == "higher" else 1


def _means(views: Array) -> Array:
    """(M,) of (V, M), each summed without rounding: no order of views changes it."""
    return np.array([math.fsum(own) / len(own) if np.isfinite(own).all() else np.mean(own) for own in views.T])


def _interval(column: Column, measured: Measured) -> tuple[Array, Array]:
    """The 95 % interval of each mean, within the range of the metric: with few views it would leave that."""
    if measured.independent is None:
        return (np.full(len(measured.methods), np.nan),) * 2
    low, high = mean_intervals(measured.independent)
    return np.maximum(low, column.range[0]), np.minimum(high, column.range[1])


def _difference(gap: float, half: float) -> Difference:
    return float(gap), float(gap - half), float(gap + half)


@dataclass(frozen=True)
class _Pairs:
    """gap: (M, M), how far method j is behind method i, [i, j]; half: (M, M), half of the interval, NaN without one."""

    gap: Array
    half: Array

    @classmethod
    def of(cls, worse: Array, independent: Units | None) -> _Pairs:
        """worse: (M,) means, the best the smallest."""
        with np.errstate(invalid="ignore"):
            gap, half = worse - worse[:, None], np.full((len(worse), len(worse)), np.nan)
        if independent is not None:
            np.fill_diagonal(half, np.where(np.isfinite(worse), 0.0, np.nan))
            if pairs := list(combinations(range(len(worse)), 2)):
                i, j = np.transpose(pairs)
                half[i, j] = half[j, i] = differences(independent, pairs)
        return cls(gap, half)

    def places(self) -> Array:
        """1 + how many methods have the better mean."""
        return np.asarray(1 + (self.gap > _EQUAL).sum(axis=0))

    def ranks(self) -> Array:
        """1 + how many methods are better by more than chance; by their mean where chance is not known."""
        surely = self.gap - np.nan_to_num(self.half) > _EQUAL
        return np.asarray(1 + surely.sum(axis=0))


def _best_in(worse: Array) -> Array:
    """In how many views each method is the best; equal methods share a view. worse: (V, M), the best the smallest."""
    leads = worse <= worse.min(axis=1, keepdims=True) + _EQUAL
    return np.asarray((leads / leads.sum(axis=1, keepdims=True)).sum(axis=0))


def _beats(worse: Array, baseline: int) -> Array:
    """In how many views each method beats the baseline; an equal view counts half. NaN for the baseline."""
    lead = -_less(worse, worse[:, [baseline]])
    wins = np.asarray(((lead > _EQUAL) + 0.5 * (np.abs(lead) <= _EQUAL)).sum(axis=0))
    wins[baseline] = np.nan
    return wins


def _less(values: Array, other: Array) -> Array:
    """A difference in which equal infinities are equal."""
    with np.errstate(invalid="ignore"):
        return np.where(values == other, 0.0, values - other)


def _effect(reference: Array, views: Array, sign: int) -> float:
    """The mean gain over the reference, in standard deviations of the gain. views: (V,); positive = better."""
    gain = _less(reference, views) * sign
    if len(gain) < 2 or not np.isfinite(gain).all():
        return np.nan
    spread = gain.std(ddof=1)
    return float(gain.mean() / spread) if spread > _EQUAL else np.nan
