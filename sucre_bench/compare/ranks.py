"""The cells of one column: means over views, paired differences between methods, ranks, ties, wins, effects.

Replicates are averaged to units, units to views, views to a score: a view counts once. Scenes have no weight in a mean;
the intervals draw whole scenes (bootstrap.py).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from sucre_bench import plugins
from sucre_bench.arrays import Array, DataFrame
from sucre_bench.compare.bootstrap import Units, changes, differences, leads, mean_intervals, pseudo_values
from sucre_bench.compare.model import (
    EQUAL,
    FILLED,
    NO_DIFFERENCE,
    Cell,
    Column,
    ColumnScores,
    may_be_chance,
)
from sucre_bench.compare.words import standard_deviation
from sucre_bench.results.rows import COSTS

_VIEW = ["scene", "view"]
_UNIT = [*_VIEW, "region"]
_REPETITION = [*_UNIT, "_replicate"]


def repetitions_of(scores: DataFrame) -> DataFrame:
    """Return a metric's values before they are averaged: repetitions of units x methods, both sorted, NaN = a hole."""
    in_order = scores.sort_values("value", kind="stable")  # sums must not depend on the order of rows
    return in_order.groupby([*_REPETITION, "method"])["value"].mean().unstack("method")


def _averaged(repetitions: DataFrame) -> DataFrame:
    """Means over the repetitions that all methods have: units x methods.

    Of a unit without any such repetition, methods that lack one have a hole.
    """
    lacking = repetitions.isna()
    shared = repetitions[~lacking.any(axis=1)].groupby(level=_UNIT).mean()
    means = repetitions.groupby(level=_UNIT).mean().mask(lacking.groupby(level=_UNIT).any())
    return shared.reindex(means.index).fillna(means)


def column_of(scores: DataFrame, repetitions: DataFrame, knows_colours: bool) -> tuple[Column, DataFrame]:
    """Return a metric, and its values: units x methods, both sorted, NaN = a hole.

    knows_colours: whether a score of the table compares with true colours.
    """
    values = _averaged(repetitions)
    left = values.dropna().index
    first: Any = scores.iloc[0]
    metric, variant = str(first["metric"]), str(first["variant"])
    plugin = plugins.usable("metric").get(metric)
    limits = (0 if metric in COSTS else -math.inf, math.inf)  # of a metric that is not installed
    if plugin or metric == FILLED:
        limits = plugin.range if plugin else (0, 1)
    column = Column(
        metric=metric,
        variant=variant,
        unit=str(first["unit"]),
        better="none" if plugin and variant in plugin.unranked else str(first["better"]),
        range=limits,
        of="image" if (scores["region"] == "image").all() else "chart",
        n_units=len(left),
        n_views=len(left.droplevel("region").unique()),
        n_scenes=left.get_level_values("scene").nunique(),
        missing=len(values) - len(left),
        pixels="common" if "pixels" in scores and (scores["pixels"] == "common").any() else "own",
        competes=knows_colours or plugin is None or not plugin.is_of_picture_alone,
    )
    return column, values


def measured_column(column: Column, values: DataFrame) -> ColumnScores:
    """Return the numbers of a column. values: units x methods, both sorted, NaN = a hole."""
    complete = values.dropna()
    std = standard_deviation(complete.to_numpy())
    per_view = complete.groupby(level=_VIEW).mean()
    views, scenes = per_view.to_numpy(), per_view.groupby(level="scene").size().tolist()
    is_of_pairs = len(scenes) == 1 and column.plugin is not None and column.plugin.is_of_pairs
    units = None
    if column.metric != FILLED and len(views) > (2 if is_of_pairs else 1):
        units = Units.of(pseudo_values(views) if is_of_pairs else views, scenes)
    holes = values.isna().sum().to_numpy()
    return ColumnScores(tuple(map(str, values.columns)), tuple(per_view.index), views, std, holes, units)


def means(views: Array) -> Array:
    """Return means (M,) of (V, M), each summed without rounding: no order of views changes it."""
    return np.array(
        [
            math.fsum(of_method) / len(of_method) if np.isfinite(of_method).all() else np.mean(of_method)
            for of_method in views.T
        ]
    )


def cells(column: Column, measured: ColumnScores, apart: Collection[str] = ()) -> list[Cell]:
    """Return the cell of each method of `measured`, compared with the best.

    apart: methods that are not compared, unless all are: their cells have no place.
    """
    size = _size(measured.views)  # scores that cancel out leave rounding errors, far below their size
    mean = means(measured.views)
    low = high = np.full_like(mean, np.nan)
    if measured.independent is not None:  # within the range of the metric: with few views intervals would leave it
        low, high = mean_intervals(measured.independent)
        low, high = np.maximum(low, column.range[0]), np.minimum(high, column.range[1])
    mean, low, high = (_known(one, size) for one in (mean, low, high))
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
    """Compare pairs of methods [i, j]; those of the best are judged by its leads."""
    views, sign, methods = measured.views, _sign(column), len(made)
    size = _size(views)
    sizes, worse = np.maximum(size, size[:, None]), means(views) * sign
    gap, half = _less(worse, worse[:, None], sizes), np.full_like(sizes, np.nan)  # how far j is behind i; half interval
    places = 1 + (gap > 0).sum(axis=0)
    best, wins = int(np.argmin(places)), _best_in(views * sign, size)
    if measured.independent is not None:
        np.fill_diagonal(half, np.where(np.isfinite(worse), 0.0, np.nan))
        if pairs := list(combinations(range(methods), 2)):
            i, j = np.transpose(pairs)
            half[i, j] = half[j, i] = differences(measured.independent, pairs)
            others = np.arange(methods) != best
            half[best, others] = half[others, best] = leads(measured.independent, best)[others]
    low, high = _known(gap - half, sizes), _known(gap + half, sizes)
    is_surely_behind = (gap > 0) & ~((low <= 0) & (high >= 0))  # by the mean where chance is not known
    ranks = 1 + is_surely_behind.sum(axis=0)
    ranked = []
    for m, cell in enumerate(made):
        behind = float(gap[best, m]), float(low[best, m]), float(high[best, m])
        lead = _less(views[:, best], views[:, m], size[[best, m]].max()) * sign
        ranked.append(
            replace(
                cell,
                place=int(places[m]),
                rank=int(ranks[m]) if column.ranked else int(places[m]),
                tie=bool(column.ranked and places[m] > 1 and may_be_chance(behind)),
                behind=behind,
                wins=float(wins[m]),
                effect=_effect(lead) if m != best else np.nan,
            )
        )
    return ranked


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
        low, high = (_known(gap[m] + end, size[m]) for end in (-half[m], half[m]))
        change = float(gap[m]), float(low), float(high)
        wins = float((lead[:, m] > 0).sum() + 0.5 * (lead[:, m] == 0).sum())
        made.append(replace(cell, change=change, wins=wins, effect=_effect(lead[:, m])))
    return made


def _sign(column: Column) -> int:
    """What turns scores into numbers of which the best is the smallest."""
    return -1 if column.better == "higher" else 1


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
