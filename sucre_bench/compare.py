"""From the long table to an answer: which method is better, by how much, and whether that is more than chance.

A score's unit is an image, or a chart where the metric scores charts. Methods are compared on the units that all of
them have (a method without any restricts nobody). Charts of one view share its water and light, so a view counts
once, with the mean over its charts. Intervals are Student's, 95 %, over views: with the few views there often are, a
bootstrap would promise too much. Two methods tie when the interval of their paired difference holds 0.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from sucre_bench import results
from sucre_bench.errors import InputError, did_you_mean
from sucre_bench.scene import Array

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["COSTS", "By", "Cell", "Column", "Comparison", "compare", "load"]

By = Literal["method", "view", "region"]

# What a restoration takes: shown with the scores, but nobody wins by it.
COSTS = ("seconds", "peak_mb")

_UNIT = ["scene", "view", "region"]


@dataclass(frozen=True)
class Column:
    """A metric in one variant.

    of: "image" or "chart", what a unit is; n_units, n_views: what all methods have; missing: units some method lacks.
    """

    metric: str
    variant: str
    unit: str
    better: str
    of: Literal["image", "chart"]
    n_units: int
    n_views: int
    missing: int


@dataclass(frozen=True)
class Cell:
    """A method's score.

    mean: over views; std: over units; low, high: 95 % interval of the mean, NaN for one view; rank: 1 = best;
    tie: not the best, but no different from it by more than chance; behind: the paired difference to the best,
    positive = worse, and its 95 % interval.
    """

    mean: float
    std: float
    low: float
    high: float
    rank: int
    tie: bool
    behind: tuple[float, float, float]


@dataclass(frozen=True)
class Comparison:
    """One table: methods x columns; a missing cell is a hole.

    title: the dataset, and the view or region where the table is of one; stale: methods left out because their rows
    come from other data than the newest.
    """

    title: str
    methods: tuple[str, ...]
    columns: tuple[Column, ...]
    cells: dict[tuple[str, Column], Cell]
    stale: tuple[str, ...] = ()


def load(folders: Iterable[str | Path]) -> pd.DataFrame:
    """Read the tables of several output folders as one; of a score that several hold, the newest that is ok.

    Raises InputError when a folder has none, when folders mean different options or code by one method, or hold
    results on different data.
    """
    import pandas as pd

    folders = [Path(f) for f in folders]
    rows = pd.concat([results.read(f) for f in folders], ignore_index=True)
    if len(folders) > 1:
        _refuse_several(
            rows[rows["scene"] != ""], ["dataset", "scene"], "data_id", "the data differ between these runs"
        )
        own = rows.assign(_code=rows["code"].str.split(".").str[0])
        _refuse_several(own, ["dataset", "method"], "options_id", "these folders mean different options by it")
        _refuse_several(
            own, ["dataset", "method"], "_code", "these folders hold it from different versions of its code"
        )
    rows = rows.assign(_ok=rows["status"] == "ok").sort_values(["_ok", "time"], kind="stable")
    score = ["dataset", "method", "metric", "variant", *_UNIT]
    return rows.drop_duplicates(score, keep="last").drop(columns="_ok").sort_index(ignore_index=True)


def _refuse_several(rows: pd.DataFrame, group: list[str], column: str, fault: str) -> None:
    several = rows.groupby(group)[column].nunique()
    if (several > 1).any():
        names = " / ".join(several[several > 1].index[0])
        raise InputError(f"{names}: {fault}; run it again, or give it another label")


def compare(
    rows: pd.DataFrame, metrics: Sequence[str] = (), by: By = "method", order: Sequence[str] = ()
) -> list[Comparison]:
    """Return a table per dataset; by "view" or "region", a table for each of those.

    metrics: "name" or "name:variant", default all; order: of the methods, default as they were first run.
    Raises InputError for a metric the rows do not have.
    """
    rows = _chosen(rows, metrics)
    order = list(dict.fromkeys([*order, *rows.sort_values("time", kind="stable")["method"]]))
    if by == "method":
        groups = rows.groupby(["dataset"], sort=False)
    else:
        rows = rows[rows["view"] != ""]
        several = rows.groupby("dataset")["scene"].nunique().max() > 1
        groups = rows.groupby(["dataset", *(["scene"] if several else []), by], sort=False)
    return [
        _table(" · ".join(map(str, key)), own, [n for n in order if n in set(own["method"])]) for key, own in groups
    ]


def _chosen(rows: pd.DataFrame, metrics: Sequence[str]) -> pd.DataFrame:
    rows = rows[~rows["region"].str.contains("/", regex=False)]  # patches are inside their charts' scores
    if not metrics:
        return rows
    full = rows["metric"] + ":" + rows["variant"]
    for name in metrics:
        if name not in {*rows["metric"], *full}:
            raise InputError(f"no scores of '{name}'; {did_you_mean(name, set(rows['metric']))}")
    return rows[rows["metric"].isin(metrics) | full.isin(metrics)]


def _table(title: str, rows: pd.DataFrame, methods: list[str]) -> Comparison:
    newest = rows.sort_values("time", kind="stable").groupby("scene")["data_id"].transform("last")
    is_stale = rows["data_id"] != newest.loc[rows.index]
    stale = [name for name in methods if is_stale[rows["method"] == name].all()]
    rows = rows[~is_stale & (rows["status"] == "ok") & rows["value"].notna()]
    columns: list[Column] = []
    cells: dict[tuple[str, Column], Cell] = {}
    for (metric, variant), scores in rows.groupby(["metric", "variant"], sort=False):
        values = scores.pivot_table(index=_UNIT, columns="method", values="value", aggfunc="first")
        everywhere = values.dropna()
        first = scores.iloc[0]
        column = Column(
            str(metric),
            str(variant),
            first["unit"],
            first["better"],
            "image" if (scores["region"] == "image").all() else "chart",
            len(everywhere),
            len(everywhere.groupby(level=["scene", "view"])),
            len(values) - len(everywhere),
        )
        columns.append(column)
        for name, cell in _cells(everywhere, column.better == "lower").items():
            cells[name, column] = replace(cell, tie=False) if column.metric in COSTS else cell
    columns.sort(key=lambda c: c.metric in COSTS)  # scores as they were run, what a restoration costs last
    return Comparison(title, tuple(n for n in methods if n not in stale), tuple(columns), cells, tuple(stale))


def _cells(values: pd.DataFrame, lower_is_better: bool) -> dict[str, Cell]:
    """Cells of one column. values: units x methods, no hole; infinite values have no interval."""
    if values.empty:
        return {}
    by_view = values.groupby(level=["scene", "view"]).mean().to_numpy()  # (V, M)
    mean = by_view.mean(axis=0)
    worse = mean if lower_is_better else -mean
    best = int(np.argmin(worse))
    with np.errstate(invalid="ignore"):  # infinity minus infinity
        behind = (by_view - by_view[:, [best]]) * (1 if lower_is_better else -1)
        half, half_behind = _half_interval(by_view), _half_interval(behind)
        std = values.to_numpy().std(axis=0)
        lead = worse - worse[best]
    return {
        str(name): Cell(
            mean=float(mean[m]),
            std=float(std[m]),
            low=float(mean[m] - half[m]),
            high=float(mean[m] + half[m]),
            rank=int((worse < worse[m] - 1e-12).sum()) + 1,
            tie=bool(worse[m] > worse[best] + 1e-12 and lead[m] <= half_behind[m]),
            behind=(float(lead[m]), float(lead[m] - half_behind[m]), float(lead[m] + half_behind[m])),
        )
        for m, name in enumerate(values.columns)
    }


def _half_interval(values: Array) -> Array:
    """Half the 95 % interval of the mean of each column (V, M); NaN for one row, or values that are not finite."""
    from scipy.stats import t

    n = len(values)
    if n < 2:
        return np.full(values.shape[1], np.nan)
    return np.asarray(t.ppf(0.975, n - 1) * values.std(axis=0, ddof=1) / np.sqrt(n))
