"""Turns the score table into one with a column for each metric, and one row for each view and method."""

from sucre_bench.arrays import DataFrame
from sucre_bench.results.rows import KEYS

_INDEX = list(KEYS)


def wide(rows: DataFrame) -> DataFrame:
    """Return scores with one row for each view and method, and one column for each metric.

    - rows: the score table, from `sb.score`, `results.read` or scores.parquet.

    The score of a chart metric is the mean over the view's charts; scores of single patches are left out. So means of
    this table do not mix charts with their patches, as ``groupby(["method", "metric"]).value.mean()`` of the rows
    would. A column is called "metric", or "metric:variant" if the rows hold several variants of it. NaN: no score.

    >>> import pandas as pd
    >>> rows = pd.DataFrame({
    ...     "dataset": "dive", "scene": "reef", "view": "a.png", "method": "sucre", "metric": "psi",
    ...     "variant": "colour", "region": ["near", "far", "near/red"], "value": [4.0, 6.0, 90.0], "status": "ok"})
    >>> float(wide(rows)["psi"].iloc[0])
    5.0
    """
    scores = rows[(rows["status"] == "ok") & ~rows["region"].str.contains("/", regex=False)]
    several = rows.groupby("metric")["variant"].nunique() > 1
    full = scores["metric"] + ":" + scores["variant"]
    name = full.where(scores["metric"].map(several).astype(bool), scores["metric"])
    order = list(dict.fromkeys(name))
    table = scores.assign(_name=name).groupby([*_INDEX, "_name"], sort=False)["value"].mean().unstack("_name")
    every = rows.loc[rows["view"] != "", _INDEX].drop_duplicates()
    table = table.reindex(index=every.set_index(_INDEX).index, columns=order)
    return table.rename_axis(columns=None)
