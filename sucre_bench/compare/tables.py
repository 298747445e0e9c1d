"""From rows to comparisons: which units all methods have, and a table for each dataset, view or region."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sucre_bench import plugins, results
from sucre_bench.arrays import Array
from sucre_bench.compare.bootstrap import resampled_means
from sucre_bench.compare.missing import notes
from sucre_bench.compare.model import Cell, Column, Comparison
from sucre_bench.compare.ranks import cells
from sucre_bench.errors import InputError, did_you_mean
from sucre_bench.plugins.plugin import Plugin
from sucre_bench.results.rows import COSTS, By

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["asked_for", "compare", "is_fresh", "without_replicates"]

_VIEW = ["scene", "view"]
_UNIT = [*_VIEW, "region"]
_REPETITION = [*_UNIT, "_replicate"]


def compare(
    rows: pd.DataFrame,
    metrics: Sequence[str] = (),
    by: By = "method",
    order: Sequence[str] = (),
    baseline: str = "",
) -> list[Comparison]:
    """Return a table per dataset; by "view" or "region", a table for each of those.

    metrics: "name" or "name:variant", default all; order: of the methods, default as they were first run; baseline: a
    method to compare the others with, instead of with the best.
    Raises InputError for a metric or a baseline that the rows do not have.
    """
    asked = asked_for(rows, metrics)
    rows = rows.sort_values("time", kind="stable")  # datasets, methods and metrics as they were run
    order = list(dict.fromkeys([*order, *rows["method"].unique()]))
    if baseline and baseline not in order:
        raise InputError(f"no scores of '{baseline}' to compare with; {did_you_mean(baseline, order)}")
    rows = rows.assign(_fresh=is_fresh(rows), _asked=asked)
    numbers = {name: results.unreplicated(name)[1] for name in rows["scene"].unique()}
    rows = without_replicates(rows.assign(_replicate=rows["scene"].map(numbers)))
    rows = rows[~rows["region"].str.contains("/", regex=False)]  # patches are inside their charts' scores
    groups = ["dataset"]
    if by != "method":
        rows = rows[rows["view"] != ""]
        several = rows.groupby("dataset")["scene"].nunique().max() > 1
        groups += ["scene", by] if several else [by]
    tables = []
    for key, own in rows.groupby(groups, sort=False):
        if by == "region":
            own = _with_reasons(own, rows[(rows[groups[:-1]] == list(key[:-1])).all(axis=1)])
        if own["_asked"].any():
            methods = sorted(own["method"].unique(), key=order.index)
            tables.append(_table(" · ".join(map(str, key)), own, methods, baseline))
    scored = [table for table in tables if table.columns]
    return scored if by != "method" and scored else tables  # of a region that some views lack


def _with_reasons(region: pd.DataFrame, everywhere: pd.DataFrame) -> pd.DataFrame:
    """A region's scores, and the rows of other regions that say why it lacks some: a failure is of a whole image."""
    import pandas as pd

    elsewhere = everywhere.drop(region.index)
    tells_why = (elsewhere["metric"] == "seconds") | (elsewhere["status"] != "ok")
    scored = region["_asked"] & (region["status"] == "ok").any()
    return pd.concat([region.assign(_asked=scored), elsewhere[tells_why].assign(_asked=False)])


def asked_for(rows: pd.DataFrame, metrics: Sequence[str]) -> pd.Series:
    """Tell which rows are of the metrics named, "name" or "name:variant"; all where none is."""
    if not metrics:
        return rows["metric"].notna()
    full = rows["metric"] + ":" + rows["variant"]
    known = set(rows["metric"].unique())
    for text in metrics:
        name, _, variant = text.partition(":")
        if name not in known:
            raise InputError(f"no scores of '{name}'; {did_you_mean(name, known)}")
        variants = set(rows.loc[rows["metric"] == name, "variant"].unique())
        if variant and variant not in variants:
            raise InputError(f"no scores of {name} in variant '{variant}'; {did_you_mean(variant, variants)}")
    return rows["metric"].isin(metrics) | full.isin(metrics)


def is_fresh(rows: pd.DataFrame) -> pd.Series:
    """Tell which rows come from the newest data of their scene."""
    newest = rows.groupby(["dataset", "scene", "data_id"])["time"].transform("max")
    return newest == newest.groupby([rows["dataset"], rows["scene"]]).transform("max")


def without_replicates(rows: pd.DataFrame) -> pd.DataFrame:
    """Give the scenes of repetitions the name of what they repeat."""
    names = {name: results.unreplicated(name)[0] for name in rows["scene"].unique()}
    return rows.assign(scene=rows["scene"].map(names))


def _table(title: str, rows: pd.DataFrame, methods: list[str], baseline: str) -> Comparison:
    with_fresh = set(rows.loc[rows["_fresh"], "method"].unique())
    stale = tuple(name for name in methods if name not in with_fresh)
    methods = [name for name in methods if name in with_fresh]
    ok = rows[rows["_fresh"] & rows["_asked"] & (rows["status"] == "ok") & rows["value"].notna()]
    made_of = [(own, _repetitions(own)) for _, own in ok.groupby(["metric", "variant"], sort=False)]
    of_columns = [(*_column(own, repeats), repeats) for own, repeats in made_of]
    scores = {column: values for column, values, _ in of_columns}
    repetitions = {column: repeats for column, _, repeats in of_columns}
    columns = sorted(scores, key=lambda c: (c.better == "none", c.metric in COSTS))  # else as they were run
    said = notes(rows[rows["method"].isin(methods)], scores, repetitions, methods)
    if stale:
        said.append(f"left out, for they ran on other data: {', '.join(stale)}")
    if baseline and baseline not in methods:
        said.append(f"{baseline} was not run here: there is nothing to compare with")
        baseline = ""
    made = _cells(scores, baseline)
    return Comparison(title, tuple(methods), tuple(columns), made, stale, baseline, tuple(said))


def _repetitions(scores: pd.DataFrame) -> pd.DataFrame:
    """The values of a metric before they are averaged: repetitions of units x methods, both sorted, NaN = a hole."""
    return scores.groupby([*_REPETITION, "method"])["value"].mean().unstack("method")


def _averaged(repetitions: pd.DataFrame) -> pd.DataFrame:
    """Means over the repetitions that all methods have: units x methods.

    Of a unit without any such repetition, methods that lack one have a hole.
    """
    lacking = repetitions.isna()
    shared = repetitions[~lacking.any(axis=1)].groupby(level=_UNIT).mean()
    own = repetitions.groupby(level=_UNIT).mean().mask(lacking.groupby(level=_UNIT).any())
    return shared.reindex(own.index).fillna(own)


def _column(scores: pd.DataFrame, repetitions: pd.DataFrame) -> tuple[Column, pd.DataFrame]:
    """A metric, and its values: units x methods, both sorted, NaN = a hole."""
    values = _averaged(repetitions)
    left = values.dropna().index
    first: Any = scores.iloc[0]
    column = Column(
        metric=str(first["metric"]),
        variant=str(first["variant"]),
        unit=str(first["unit"]),
        better=str(first["better"]),
        range=_range(str(first["metric"])),
        of="image" if (scores["region"] == "image").all() else "chart",
        n_units=len(left),
        n_views=len(left.droplevel("region").unique()),
        n_scenes=left.get_level_values("scene").nunique(),
        missing=len(values) - len(left),
    )
    return column, values


def _range(metric: str) -> tuple[float, float]:
    """Of a metric's possible values, any where it is not installed here."""
    plugin = plugins.discover("metric").get(metric)
    if isinstance(plugin, Plugin):
        return plugin.range
    return (0, math.inf) if metric in COSTS else (-math.inf, math.inf)


def _cells(scores: dict[Column, pd.DataFrame], baseline: str) -> dict[tuple[str, Column], Cell]:
    """All cells; columns of the same units are resampled together, which costs no more than one of them."""
    made: dict[tuple[str, Column], Cell] = {}
    complete = {column: values.dropna() for column, values in scores.items() if column.n_units}
    resampled = _resampled(complete)
    for column, values in complete.items():
        names = list(values.columns)
        views = values.groupby(level=_VIEW).mean().to_numpy()
        with np.errstate(invalid="ignore"):  # infinity minus infinity
            std = values.to_numpy().std(axis=0)
        holes = scores[column].isna().sum().to_numpy()
        to = names.index(baseline) if baseline in names else None
        of_column = cells(column, views, std, resampled.get(column), holes, to)
        made.update({(str(name), column): cell for name, cell in zip(names, of_column, strict=True)})
    return made


def _resampled(complete: dict[Column, pd.DataFrame]) -> dict[Column, Array]:
    """The resampled means (M, R) of each column that has more than one view."""
    alike: list[list[Column]] = []
    for column, values in complete.items():
        for own in alike:
            if complete[own[0]].index.equals(values.index):
                own.append(column)
                break
        else:
            if column.n_views > 1:
                alike.append([column])
    made: dict[Column, Array] = {}
    for own in alike:
        charts = complete[own[0]].groupby(level=_VIEW).size()  # sorted as the units are
        views = charts.groupby(level="scene").size()
        values = np.hstack([complete[column].to_numpy() for column in own])
        means = resampled_means(values, views.to_numpy(), charts.to_numpy())
        ends = np.cumsum([complete[column].shape[1] for column in own])[:-1]
        made.update(zip(own, np.split(means, ends), strict=True))
    return made
