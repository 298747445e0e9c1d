"""Means: of replicates to units, of units to views, and of views to a method's score. A view counts once.

Scenes have no weight in a mean; the intervals draw whole scenes (bootstrap.py).
"""

import math
from typing import Any

import numpy as np

from sucre_bench import plugins
from sucre_bench.arrays import Array, DataFrame
from sucre_bench.compare.bootstrap import Units, pseudo_values
from sucre_bench.compare.choose_pixels import FILLED
from sucre_bench.compare.model import Column, ColumnScores
from sucre_bench.compare.numbers import standard_deviation
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
    column = Column(
        metric=metric,
        variant=variant,
        unit=str(first["unit"]),
        better="none" if plugin and variant in plugin.unranked else str(first["better"]),
        range=_range(metric),
        of="image" if (scores["region"] == "image").all() else "chart",
        n_units=len(left),
        n_views=len(left.droplevel("region").unique()),
        n_scenes=left.get_level_values("scene").nunique(),
        missing=len(values) - len(left),
        pixels="common" if "pixels" in scores and (scores["pixels"] == "common").any() else "own",
        competes=knows_colours or plugin is None or not plugin.is_of_picture_alone,
    )
    return column, values


def _range(metric: str) -> tuple[float, float]:
    """The range of a metric's values; unlimited if the metric is not installed."""
    if plugin := plugins.usable("metric").get(metric):
        return plugin.range
    if metric == FILLED:
        return 0, 1
    return (0, math.inf) if metric in COSTS else (-math.inf, math.inf)


def measured_column(column: Column, values: DataFrame) -> ColumnScores:
    """Return the numbers of a column. values: units x methods, both sorted, NaN = a hole."""
    complete = values.dropna()
    std = standard_deviation(complete.to_numpy())
    per_view = complete.groupby(level=_VIEW).mean()
    views, scenes = per_view.to_numpy(), per_view.groupby(level="scene").size().tolist()
    independent = _independent(column, views, scenes)
    return ColumnScores(tuple(map(str, values.columns)), views, std, values.isna().sum().to_numpy(), independent)


def _independent(column: Column, views: Array, scenes: list[int]) -> Units | None:
    """The independent units, None where there are too few. views: (V, M); scenes: how many views each has."""
    if column.metric == FILLED:
        return None
    if len(scenes) > 1 or not (column.plugin and column.plugin.is_of_pairs):  # a score is no mean over pairs of views
        return Units.of(views, scenes) if len(views) > 1 else None
    return Units.of(pseudo_values(views), scenes) if len(views) > 2 else None


def means(views: Array) -> Array:
    """Return means (M,) of (V, M), each summed without rounding: no order of views changes it."""
    return np.array(
        [
            math.fsum(of_method) / len(of_method) if np.isfinite(of_method).all() else np.mean(of_method)
            for of_method in views.T
        ]
    )
