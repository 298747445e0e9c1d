"""Chooses the pixels for a comparison: the own pixels of each method, or the common pixels of all.

Where methods fill different pixels of a view, their own scores are of different pictures. A run therefore scores such
views on their common pixels too (`engine.common_pixels`), and `on_pixels` puts these scores in the place of the
own ones.
"""

import json
import math
from collections.abc import Callable
from typing import Literal

import numpy as np

from sucre_bench import plugins
from sucre_bench.arrays import DataFrame, Series
from sucre_bench.results.common_scores import COMMON_PIXELS, LEAST_DIFFERENCE, LEAST_FILLED
from sucre_bench.results.reasons import Reason
from sucre_bench.results.rows import KEYS, restorations, values_of
from sucre_bench.results.table import is_fresh

Pixels = Literal["own", "common"]

NOT_SCORED = "not scored on common pixels; run all methods into one folder"

_VIEW = ["dataset", "scene", "view"]
_SCORE = [*_VIEW, "metric", "variant"]
_KEY = [*_SCORE, "method", "code", "_mask"]
_RESULT = ["value", "n_pixels", "coverage", "status", "reason"]


def leaves_holes(rows: DataFrame) -> bool:
    """Whether a method leaves a hole in a view, in data old or new: else all fill the same pixels."""
    return bool((restorations(rows)["coverage"] < 1).any())


def on_own_pixels(rows: DataFrame) -> DataFrame:
    """Return rows with the columns of `on_pixels`, every score as it is."""
    return rows.assign(pixels="own", pixels_share=math.nan, pixels_reason="")


def on_pixels(rows: DataFrame, read: Callable[[], DataFrame]) -> DataFrame:
    """Return rows with scores on common pixels in the place of own ones, where methods fill a view differently.

    rows: of the score table; read: returns the scores on common pixels, see `results.read_common`; it is called only
    where a method `leaves_holes`.
    Three columns are added. `pixels`: "own" or "common"; `pixels_share`: the share of the image that the common pixels
    have, else NaN; `pixels_reason`: why a score is on own pixels although methods fill the view differently.
    """
    rows = on_own_pixels(rows)
    if not leaves_holes(rows):
        return rows
    common = read()
    whole = restorations(rows[is_fresh(rows)])
    enough = whole[whole["coverage"] >= LEAST_FILLED]
    scored = rows[scores_of_pixels(rows) & (rows["status"] == "ok")]
    # A method that fills next to nothing of a view has no score of it, if another one fills more.
    some = {*values_of(enough, *_VIEW)}
    little = {which for which in values_of(whole.drop(enough.index), *KEYS) if which[:3] in some}
    is_lost = np.array([which in little for which in values_of(scored, *KEYS)], dtype=bool)
    rows.loc[scored.index[is_lost], _RESULT] = [math.nan, 0, 0.0, "skipped", Reason.FILLS_LITTLE.value]
    scored = scored[~is_lost].join(_views(enough, common), on=_VIEW, how="inner")
    if scored.empty:
        return rows
    found = common[common["metric"] != COMMON_PIXELS].rename(columns={"pixels": "_mask"})
    found = found[[*_KEY, *_RESULT]].drop_duplicates(_KEY, keep="last")
    new = scored[_KEY].merge(found, on=_KEY, how="left").set_axis(scored.index)
    # No score is on common pixels that are not known, whatever a bundle says: `verify` does not compute it again.
    new.loc[~scored["_kind"].isin(["common", "none"]), ["status", "reason"]] = None
    new.loc[scored["_kind"] == "none", _RESULT] = [math.nan, 0, 0.0, "skipped", Reason.NO_SHARED_PIXELS.value]
    # Of one score of a view, either all methods are on common pixels or none.
    lacks = new["status"].isna() | new["reason"].isin([Reason.NOT_STORED.value, Reason.NOT_HELD.value])
    why = new["reason"].fillna(scored["_why"].where(scored["_why"] != "", NOT_SCORED)).where(lacks)
    score = [scored[name] for name in _SCORE]
    lacks, why = lacks.groupby(score).transform("any"), why.groupby(score).transform("first")
    placed = scored.index[~lacks]
    for name in _RESULT:
        rows.loc[placed, name] = new.loc[placed, name].astype(rows[name].dtype)
    rows.loc[placed, "pixels"] = "common"
    rows.loc[scored.index, "pixels_share"] = scored["_share"].astype(float)
    rows.loc[scored.index[lacks], "pixels_reason"] = why[lacks]
    return rows


def _views(whole: DataFrame, common: DataFrame) -> DataFrame:
    """What is known of each view that methods fill differently, by `_VIEW`. whole: the views' restorations.

    `_kind`: "common", "none" or "unknown" of `sucre_bench.results.common_scores.Kind`; `_mask`: hash of the common
    mask; `_share`: of the image that it has; `_why`: why it is not known. A view in the table of common scores counts
    only if it covers all methods and their newest results.
    """
    said = common[common["metric"] == COMMON_PIXELS].drop_duplicates(_VIEW, keep="last").set_index(_VIEW)
    said = said[["variant", "pixels", "value", "reason", "methods", "time"]]
    said.columns = [*(state := ["_kind", "_mask", "_share", "_why"]), "_methods", "_time"]
    coverage = ("coverage", "min"), ("coverage", "max")
    views = whole.groupby(_VIEW).agg(low=coverage[0], high=coverage[1], by=("method", set), last=("time", "max"))
    views = views[(views["low"] < 1) & (views["by"].map(len) > 1)].join(said)
    names = views["_methods"].fillna("[]").map(json.loads).map(set)
    is_known = np.array([by <= of for by, of in zip(views["by"], names, strict=True)], dtype=bool)
    is_known &= (views["last"] <= views["_time"].fillna("")).to_numpy()
    views.loc[~is_known, state] = ["unknown", "", math.nan, NOT_SCORED]
    differs = np.where(is_known, views["_kind"] != "equal", views["high"] - views["low"] > LEAST_DIFFERENCE)
    return views.loc[differs, state]


def scores_of_pixels(rows: DataFrame) -> Series:
    """Return which rows are scores of whole images by metrics that rank pictures by their pixels.

    A metric that is not installed does not.
    """
    metrics = {str(name): plugins.installed("metric", str(name)) for name in rows["metric"].unique()}
    of_pixels = [name for name, plugin in metrics.items() if plugin and plugin.is_of_pixels]
    return rows["metric"].isin(of_pixels) & (rows["region"] == "image")
