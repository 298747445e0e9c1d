"""Chooses the pixels for a comparison: the own pixels of each method, or the common pixels of all.

Where methods fill different pixels of a view, their own scores are of different pictures. A run therefore scores such
views on their common pixels too (`engine.common_pixels`), and `on_pixels` puts these scores in the place of the
own ones.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

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


def on_pixels(rows: DataFrame, common: DataFrame, pixels: Pixels = "common") -> DataFrame:
    """Return rows with scores on common pixels in the place of own ones, where methods fill a view differently.

    rows: of the score table; common: of `results.read_common`; pixels: "own" leaves every score as it is.
    Three columns are added. `pixels`: "own" or "common"; `pixels_share`: the share of the image that the common pixels
    have, else NaN; `pixels_reason`: why a score is on own pixels although methods fill the view differently.
    """
    rows = rows.assign(pixels="own", pixels_share=math.nan, pixels_reason="")
    if pixels == "own":
        return rows
    whole = restorations(rows)
    if not (whole["coverage"] < 1).any():  # no method leaves a hole, in data old or new
        return rows
    whole = restorations(rows[is_fresh(rows)])
    rows = _without_little(rows, whole)
    states = _states(whole[whole["coverage"] >= LEAST_FILLED], common)
    scored = rows[scores_of_pixels(rows) & (rows["status"] == "ok")]
    scored = scored.loc[[place in states for place in _places(scored)]]
    return _replaced(rows, scored, common, states) if len(scored) else rows


def _without_little(rows: DataFrame, restorations: DataFrame) -> DataFrame:
    """Leave methods without a score of views that they fill next to nothing of, if others fill more."""
    is_little = restorations["coverage"] < LEAST_FILLED
    some = set(_places(restorations[~is_little]))
    little = restorations[is_little]
    pairs = {(place, name) for place, name in zip(_places(little), little["method"], strict=True) if place in some}
    if not pairs:
        return rows
    scores = rows[scores_of_pixels(rows) & (rows["status"] == "ok")]
    lost = [pair in pairs for pair in zip(_places(scores), scores["method"], strict=True)]
    rows.loc[scores.index[lost], _RESULT] = [math.nan, 0, 0.0, "skipped", Reason.FILLS_LITTLE.value]
    return rows


def _places(rows: DataFrame) -> list[_Place]:
    """The view of each row."""
    return [*values_of(rows, *_VIEW)]


def of_pixels(metrics: Series) -> Series:
    """Return which metrics rank pictures by their pixels; one that is not installed does not."""
    return metrics.isin({name for name, plugin in plugins.usable("metric").items() if plugin.is_of_pixels})


@dataclass(frozen=True)
class _State:
    """What is known of a view whose methods fill different pixels.

    kind: "common", "none" or "unknown" of `sucre_bench.results.common_scores.Kind`; pixels: hash of the common mask;
    share: of the image that it has; reason: why it is not known.
    """

    kind: str
    pixels: str = ""
    share: float = math.nan
    reason: str = ""


def _states(restorations: DataFrame, common: DataFrame) -> dict[_Place, _State]:
    """The views whose methods fill different pixels."""
    filled = restorations.groupby(_VIEW)["coverage"].agg(["min", "max", "size"])
    filled = filled[(filled["min"] < 1) & (filled["size"] > 1)]
    known = _known(restorations, common)
    states = {}
    for place, low, high, _ in filled.itertuples(name=None):
        if place in known:
            states[place] = known[place]
        elif high - low > LEAST_DIFFERENCE:
            states[place] = _State("unknown", reason=NOT_SCORED)
    return {place: state for place, state in states.items() if state.kind != "equal"}


def _known(restorations: DataFrame, common: DataFrame) -> dict[_Place, _State]:
    """The state of each view in the table of common scores. It counts only if it covers all methods and their newest
    results."""
    of_views = common[common["metric"] == COMMON_PIXELS]
    if of_views.empty:
        return {}
    by_view = restorations.groupby(_VIEW)
    methods, newest = by_view["method"].agg(set).to_dict(), by_view["time"].max().to_dict()
    columns = [*_VIEW, "variant", "pixels", "value", "reason", "methods", "time"]
    known = {}
    for *view, kind, pixels, share, reason, names, time in of_views[columns].itertuples(index=False, name=None):
        place = (view[0], view[1], view[2])
        if place in methods and methods[place] <= set(json.loads(names)) and newest[place] <= time:
            known[place] = _State(kind, pixels, share, reason)
    return known


def _replaced(rows: DataFrame, scored: DataFrame, common: DataFrame, states: Mapping[_Place, _State]) -> DataFrame:
    """Put common scores in the place of own ones.

    scored: the own scores of views whose methods fill different pixels.
    """
    import pandas as pd

    of = [states[place] for place in _places(scored)]
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
    """Return which rows are scores of whole images by such metrics."""
    return of_pixels(rows["metric"]) & (rows["region"] == "image")
