"""Chooses the pixels for a comparison: the own pixels of each method, or the common pixels of all.

Where methods fill different pixels of a view, their own scores are of different pictures. A run therefore scores such
views on their common pixels too (`engine.common_pixels`), and `on_pixels` puts these scores in the place of the
own ones.
"""

import json
import math
from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np

from sucre_bench import plugins
from sucre_bench.arrays import DataFrame, Series
from sucre_bench.results.common_scores import COMMON_PIXELS, LEAST_DIFFERENCE, LEAST_FILLED
from sucre_bench.results.reasons import Reason
from sucre_bench.results.rows import restorations, values_of
from sucre_bench.results.table import is_fresh

Pixels = Literal["own", "common"]

NOT_SCORED = "not scored on common pixels; run all methods into one folder"

_VIEW = ["dataset", "scene", "view"]
_SCORE = [*_VIEW, "metric", "variant"]
_KEY = [*_SCORE, "method", "code", "_mask"]
_RESULT = ["value", "n_pixels", "coverage", "status", "reason"]

_Place = tuple[str, str, str]


def leaves_holes(rows: DataFrame) -> bool:
    """Whether a method leaves a hole in a view, in data old or new: else all fill the same pixels."""
    return bool((restorations(rows)["coverage"] < 1).any())


def on_pixels(rows: DataFrame, common: DataFrame | None, pixels: Pixels = "common") -> DataFrame:
    """Return rows with scores on common pixels in the place of own ones, where methods fill a view differently.

    rows: of the score table; common: of `results.read_common`, None where no method `leaves_holes`; pixels: "own"
    leaves every score as it is.
    Three columns are added. `pixels`: "own" or "common"; `pixels_share`: the share of the image that the common pixels
    have, else NaN; `pixels_reason`: why a score is on own pixels although methods fill the view differently.
    """
    rows = rows.assign(pixels="own", pixels_share=math.nan, pixels_reason="")
    if common is None or pixels == "own" or not leaves_holes(rows):
        return rows
    whole = restorations(rows[is_fresh(rows)])
    scored = rows[scores_of_pixels(rows) & (rows["status"] == "ok")]
    is_little = whole["coverage"] < LEAST_FILLED
    some = {*values_of(whole[~is_little], *_VIEW)}  # a method that fills less has no score of such a view
    little = {which for which in values_of(whole[is_little], *_VIEW, "method") if which[:3] in some}
    is_lost = [which in little for which in values_of(scored, *_VIEW, "method")]
    if any(is_lost):
        lost, scored = scored.index[is_lost], scored[np.logical_not(is_lost)]
        rows.loc[lost, _RESULT] = [math.nan, 0, 0.0, "skipped", Reason.FILLS_LITTLE.value]
    states = _states(whole[~is_little], common)
    scored = scored.loc[[place in states for place in values_of(scored, *_VIEW)]]
    return _replaced(rows, scored, common, states) if len(scored) else rows


class _State(NamedTuple):
    """What is known of a view whose methods fill different pixels.

    kind: "common", "none" or "unknown" of `sucre_bench.results.common_scores.Kind`; pixels: hash of the common mask;
    share: of the image that it has; reason: why it is not known.
    """

    kind: str
    pixels: str = ""
    share: float = math.nan
    reason: str = ""


def _states(whole: DataFrame, common: DataFrame) -> dict[_Place, _State]:
    """The views whose methods fill different pixels. whole: their restorations.

    A view in the table of common scores counts only if it covers all methods and their newest results.
    """
    rows = common[common["metric"] == COMMON_PIXELS]
    columns = ("variant", "pixels", "value", "reason", "methods", "time")
    known = dict(zip(values_of(rows, *_VIEW), values_of(rows, *columns), strict=True))
    coverage = ("coverage", "min"), ("coverage", "max")
    filled = whole.groupby(_VIEW).agg(low=coverage[0], high=coverage[1], methods=("method", set), last=("time", "max"))
    states: dict[_Place, _State] = {}
    for place, low, high, methods, last in filled[filled["low"] < 1].itertuples(name=None):
        *found, names, time = known.get(place, ("unknown", "", math.nan, "", "[]", ""))
        state = _State(*found)
        if not methods <= set(json.loads(names)) or last > time:
            state = _State("unknown" if high - low > LEAST_DIFFERENCE else "equal", reason=NOT_SCORED)
        if state.kind != "equal" and len(methods) > 1:
            states[place] = state
    return states


def _replaced(rows: DataFrame, scored: DataFrame, common: DataFrame, states: Mapping[_Place, _State]) -> DataFrame:
    """Put common scores in the place of own ones.

    scored: the own scores of views whose methods fill different pixels.
    """
    import pandas as pd

    of = [states[place] for place in values_of(scored, *_VIEW)]
    scored = scored.assign(_mask=[state.pixels for state in of], _kind=[state.kind for state in of])
    found = common[common["metric"] != COMMON_PIXELS].rename(columns={"pixels": "_mask"})
    found = found[[*_KEY, *_RESULT]].drop_duplicates(_KEY, keep="last")
    new = scored[_KEY].merge(found, on=_KEY, how="left").set_axis(scored.index)
    # No score is on common pixels that are not known, whatever a bundle says: `verify` does not compute it again.
    new.loc[~scored["_kind"].isin(["common", "none"]), ["status", "reason"]] = None
    none = scored["_kind"] == "none"
    new.loc[none, _RESULT] = [math.nan, 0, 0.0, "skipped", Reason.NO_SHARED_PIXELS.value]
    # Of one score of a view, either all methods are on common pixels or none.
    lacks = new["status"].isna() | new["reason"].isin([Reason.NOT_STORED.value, Reason.NOT_HELD.value])
    why = new["reason"].fillna(pd.Series([state.reason or NOT_SCORED for state in of], scored.index)).where(lacks)
    score = [scored[name] for name in _SCORE]
    lacks, why = lacks.groupby(score).transform("any"), why.groupby(score).transform("first")
    placed = scored.index[~lacks]
    for name in _RESULT:
        rows.loc[placed, name] = new.loc[placed, name].astype(rows[name].dtype)
    rows.loc[placed, "pixels"] = "common"
    rows.loc[scored.index, "pixels_share"] = [state.share for state in of]
    rows.loc[scored.index[lacks], "pixels_reason"] = why[lacks]
    return rows


def scores_of_pixels(rows: DataFrame) -> Series:
    """Return which rows are scores of whole images by metrics that rank pictures by their pixels.

    A metric that is not installed does not.
    """
    known = [name for name, plugin in plugins.usable("metric").items() if plugin.is_of_pixels]
    return rows["metric"].isin(known) & (rows["region"] == "image")
