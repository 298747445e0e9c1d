"""Chooses the rows of a comparison: reads folders, refuses what is not comparable, and chooses the pixels of scores.

Where methods fill different pixels of a view, their own scores are of different pictures. A run therefore scores such
views on their common pixels too (`engine.common_pixels`), and `on_pixels` puts these scores in the place of the own
ones.
"""

import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import DataFrame, Series
from sucre_bench.compare.model import plugin_of
from sucre_bench.errors import InputError, LinesError, did_you_mean
from sucre_bench.machine import progress
from sucre_bench.machine.text_formats import first_few
from sucre_bench.plugins.plugin import Fault, Plugin
from sucre_bench.results.bundle_format import open_bundle
from sucre_bench.results.common_scores import (
    COMMON_PIXELS,
    LEAST_DIFFERENCE,
    LEAST_FILLED,
    kind_of,
    methods_of,
)
from sucre_bench.results.reasons import Reason
from sucre_bench.results.rows import (
    COMMON,
    COSTS,
    KEYS,
    code_parts,
    restorations,
    tuples,
    unreplicated,
    values_of,
)
from sucre_bench.results.table import is_bundle, is_fresh, read_both

# what names a score
_NAMED = [
    "dataset",
    "method",
    "metric",
    "variant",
    "scene",
    "view",
    "region",
]
_SAME = 1e-6  # relative difference of one score on two machines


def load(folders: Iterable[str | Path]) -> tuple[DataFrame, DataFrame]:
    """Read the tables of several output folders as one; of a score that several hold, the newest that is ok.

    Returns the scores on own pixels, whose column `_folder` says which they are of, and those on common pixels, see
    `on_pixels`.
    Says with `progress.say` where folders have different values. A folder may be a bundle (.zip), too.
    Raises InputError when a folder has none, when folders mean different options or code by one method, or hold results
    on different data.
    """
    import pandas as pd

    tables, on_common = [], []
    for folder in map(Path, folders):
        if is_bundle(folder):
            with open_bundle(folder) as bundle:
                rows, common = bundle.rows, bundle.common  # `verify` checks what it says
        else:
            rows, common = read_both(folder)
        tables.append(rows.assign(_folder=str(folder)))
        on_common.append(common)
    rows = pd.concat(tables, ignore_index=True)
    common = pd.concat([one for one in on_common if len(one)] or on_common, ignore_index=True)
    if len(tables) > 1:
        coded = rows.assign(_code=code_parts(rows["code"])["method"])
        of_scenes = rows[rows["scene"] != ""].groupby(["dataset", "scene"])
        of_methods = coded.groupby(["dataset", "method"])
        for groups, column, fault in (
            (of_scenes, "data_id", "the data differ between these runs"),
            (of_methods, "options_id", "these folders mean different options by it"),
            (of_methods, "_code", "these folders hold it from different versions of its code"),
        ):
            several = groups[column].nunique()
            if (several > 1).any():
                names = " / ".join(several[several > 1].index[0])
                raise InputError(f"{names}: {fault}; run it again, or give it another label")
        _say_differing(rows)
    rows = rows.assign(_ok=rows["status"] == "ok").sort_values(["_ok", "time"], kind="stable")
    rows = rows.drop_duplicates(_NAMED, keep="last").drop(columns="_ok")
    return rows.sort_index(ignore_index=True), common


def _say_differing(rows: DataFrame) -> None:
    """Say that folders have other values of the same scores, of which the newest are taken."""
    scores = rows[(rows["status"] == "ok") & ~rows["metric"].isin(COSTS)]
    twice = scores[scores.duplicated(_NAMED, keep=False)]
    of_score = twice.groupby(_NAMED)["value"]
    low, high = of_score.min(), of_score.max()
    differing = low.index[high - low > _SAME * high.abs().combine(low.abs(), max)]
    if len(differing):
        folders = ", ".join(twice["_folder"].unique())
        methods = (twice["dataset"] + " / " + twice["method"])[
            twice.set_index(_NAMED).index.isin(differing)
        ].unique()
        progress.say(
            f"{folders} share {len(of_score)} scores, and have different values of {len(differing)} of them "
            f"({', '.join(methods)}); the table shows the newest. Run one with another label to see both"
        )


class NotComparableError(LinesError, InputError):
    """Methods cannot be compared: a line a reason."""


def refuse(rows: DataFrame, metrics: Sequence[str] = (), common: bool = False) -> None:
    """Raise NotComparableError where methods cannot be compared: a line a dataset and difference, with what to do.

    metrics: those to be compared, as in `compare`; common: methods may have run on different images or replicates, as
    long as they share some.
    """
    rows = rows.assign(_asked=asked_for(rows, metrics))[is_fresh(rows)]
    lines = []
    for dataset, of_dataset in rows.groupby("dataset", sort=False):
        scored = of_dataset[of_dataset["_asked"] & ~of_dataset["metric"].isin(COSTS)]
        reasons = (
            *_test_sets(of_dataset),
            *_images(of_dataset, common),
            *_variants(scored),
            *_versions(scored[scored["status"] == "ok"]),
            *mixed_codes(of_dataset),
            *_normalisations(of_dataset),
        )
        lines += [f"{dataset}: {reason}" for reason in reasons]
    if lines:
        raise NotComparableError("\n".join(lines))


def _test_sets(rows: DataFrame) -> Iterator[str]:
    """Scenes of several named test sets."""
    scenes = without_replicates(rows)["scene"].unique()
    if len(scenes) < 2:
        return
    from sucre_bench.loading.named_sets import named_sets

    sets = sorted({*scenes} & named_sets().keys())
    if len(sets) > 1:
        remedy = "run each again with a dataset.label of its own, or compare folders of one set"
        yield f"rows are of the test sets {', '.join(sets)}; {remedy}"


def without_replicates(rows: DataFrame) -> DataFrame:
    """Give the scenes of repetitions the name of what they repeat; a column `_replicate` has their numbers."""
    names = {name: unreplicated(name) for name in rows["scene"].unique()}
    return rows.assign(
        scene=rows["scene"].map({name: plain for name, (plain, _) in names.items()}),
        _replicate=rows["scene"].map({name: number for name, (_, number) in names.items()}),
    )


def _images(rows: DataFrame, common: bool) -> Iterator[str]:
    """Methods that ran on different images or replicates. Failed images count as run; a job that failed ran on all."""
    whole = rows.loc[rows["view"] == "", "method"]
    per_view = rows.loc[~rows["method"].isin(whole), ["method", "scene", "view"]]
    # (scene, view) x methods
    ran = (
        per_view.drop_duplicates().groupby(["scene", "view", "method"]).size().unstack().notna()
    )
    n_shared = int(ran.all(axis=1).sum())
    if n_shared == len(ran) or (common and n_shared):
        return
    counts = ", ".join(f"{name} on {n}" for name, n in ran.sum().items())
    lacking = ran.columns[~ran.all()][0]
    example = "/".join(ran.index[~ran[lacking]][0])
    share = "for they share none"
    if n_shared:
        share = f"or --common compares them on the {n_shared} images they share"
    why = f"{counts} ({lacking} not on {example}); run them on the same ones, {share}"
    yield f"methods ran on different images: {why}"


def _variants(rows: DataFrame) -> Iterator[str]:
    """Methods that were scored by one metric in different variants only."""
    for metric, of_metric in rows.groupby("metric", sort=False):
        variants = of_metric.groupby("method", sort=False)["variant"].agg(set)
        for (first, one), (second, other) in combinations(variants.items(), 2):
            if not one & other:
                yield (
                    f"{metric}: {first} scored in variant {', '.join(sorted(one))}, {second} in "
                    f"{', '.join(sorted(other))}; score all in one, metrics.{metric}.variants=[{min(one)}]"
                )
                break


def _versions(rows: DataFrame) -> Iterator[str]:
    """Scores of one column from different versions or options of the metric; the newest is taken as right."""
    rows = rows.assign(_made_by=code_parts(rows["code"])["metric"])
    for (metric, variant), of_variant in rows.groupby(["metric", "variant"], sort=False):
        made_by = of_variant["_made_by"]
        is_new = made_by == made_by[of_variant["time"].sort_values().index[-1]]
        if not is_new.all():
            old = ", ".join(of_variant["method"][~is_new].unique())
            new = ", ".join(of_variant["method"][is_new].unique())
            yield (
                f"{metric} ({variant}): {old} scored by another version or other options of the metric than "
                f"{new}; give the run command of {old} again, what is out of date is done anew"
            )


def mixed_codes(rows: DataFrame) -> Iterator[str]:
    """Methods of a dataset that several versions of their code restored: of which views the newest would make others.

    rows: of the newest data.
    """
    restored = restorations(rows).sort_values("time", kind="stable")
    restored = restored.assign(_made_by=code_parts(restored["code"])["method"])
    for method, of_method in restored.groupby("method", sort=False):
        last = of_method.iloc[-1]
        older = of_method["view"][of_method["_made_by"] != last["_made_by"]].unique()
        if len(older):
            yield (
                f"{method}: {first_few(older, 4)} restored by another version of its code than "
                f"{last['view']}; give their run command again, what is out of date is done anew"
            )


def _normalisations(rows: DataFrame) -> Iterator[str]:
    """Two labels of one method with different display normalisations that the labels do not mention.

    If they were fitted to different encodings, as `sucre` and `sucre` with `encoding=linear`, each needs its own.
    """
    options = options_of(rows)
    for first, second in combinations(options, 2):
        one, other = options[first], options[second]
        shown = one.get("display"), other.get("display")
        are_alike = all(one.get(name) == other.get(name) for name in ("name", "encoding"))
        if are_alike and shown[0] != shown[1] and "display=" not in first + second:
            yield (
                f"{first} and {second} are both {one.get('name')}, shown in different ways, {shown[0]} and {shown[1]}; "
                f"show them alike, or say it in a label: method.label='{second},display={shown[1]}'"
            )


def options_of(rows: DataFrame) -> dict[str, dict[str, Any]]:
    """Return the options of each method of the rows, by its label: those of its last row."""
    last = rows[["method", "options"]].drop_duplicates("method", keep="last")
    return {
        name: json.loads(text or "{}") for name, text in values_of(last, "method", "options")
    }


def asked_for(rows: DataFrame, metrics: Sequence[str]) -> Series:
    """Return which rows are of these metrics, "name" or "name:variant"; without metrics, all but those of faults."""
    if not metrics:
        return ~rows["metric"].isin(metrics_of_faults(rows))
    full = rows["metric"] + ":" + rows["variant"]
    variants = rows.groupby("metric")["variant"].unique().to_dict()
    for text in metrics:
        name, _, variant = text.partition(":")
        if name not in variants:
            raise InputError(f"no scores of '{name}'; {did_you_mean(name, variants)}")
        if variant and variant not in variants[name]:
            known = did_you_mean(variant, variants[name])
            raise InputError(f"no scores of {name} in variant '{variant}'; {known}")
    return rows["metric"].isin(metrics) | full.isin(metrics)


def metrics_in(rows: DataFrame) -> dict[str, Plugin]:
    """Return the metrics of rows by name, those that are installed."""
    known = {str(name): plugin_of(str(name)) for name in rows["metric"].unique()}
    return {name: plugin for name, plugin in known.items() if plugin}


def metrics_of_faults(rows: DataFrame) -> dict[str, Mapping[str, Fault]]:
    """Return the faults that the metrics of rows declare, by metric: tables say them in words, and have no column."""
    return {name: plugin.faults for name, plugin in metrics_in(rows).items() if plugin.faults}


# -- pixels ------------------------------------------------------------------------------------------------

Pixels = Literal["own", "common"]

NOT_SCORED = "not scored on common pixels; run all methods into one folder"

_VIEW = ["dataset", "scene", "view"]
_SCORE = [*_VIEW, "metric", "variant"]
_KEY = [*_SCORE, "method", "code", "_mask"]
_RESULT = ["value", "n_pixels", "coverage", "status", "reason"]
_NOTHING = [math.nan, 0, 0.0, "skipped"]  # of a score, a reason follows


def leaves_holes(rows: DataFrame) -> bool:
    """Whether a method leaves a hole in a view, in data old or new: else all fill the same pixels."""
    return bool((restorations(rows)["coverage"] < 1).any())


# The columns of `on_pixels`, of scores as they are.
OWN_PIXELS = {"pixels": "own", "pixels_share": math.nan, "pixels_reason": ""}


def on_pixels(rows: DataFrame, common: DataFrame) -> DataFrame:
    """Return rows with scores on common pixels in the place of own ones, where methods fill a view differently.

    rows: of the score table; common: the scores on common pixels, see `results.table.read_both`.
    Three columns are added. `pixels`: "own" or "common"; `pixels_share`: the share of the image that the common pixels
    have, else NaN; `pixels_reason`: why a score is on own pixels although methods fill the view differently.
    """
    rows = rows.assign(**OWN_PIXELS)
    if not leaves_holes(rows):
        return rows
    whole = restorations(rows[is_fresh(rows)])
    enough = whole[whole["coverage"] >= LEAST_FILLED]
    scored = rows[scores_of_pixels(rows) & (rows["status"] == "ok")]
    # A method that fills next to nothing of a view has no score of it, if another one fills more.
    little = whole.drop(enough.index)
    is_lost = among(scored, little[among(little, enough, _VIEW)], list(KEYS))
    rows.loc[scored.index[is_lost], _RESULT] = [*_NOTHING, Reason.FILLS_LITTLE.value]
    views = _views(enough, common)
    scored = scored[~is_lost].reset_index(names="_row").merge(views, on=_VIEW).set_index("_row")
    if scored.empty:
        return rows
    found = common[common["metric"] != COMMON_PIXELS]
    code = found["code"].str.rsplit(".", n=1)  # the mask's comes last, see `RowCode`
    found = found.assign(
        variant=found["variant"].str.removesuffix(COMMON), code=code.str[0], _mask=code.str[1]
    )
    found = found[[*_KEY, *_RESULT]].drop_duplicates(_KEY, keep="last")
    new = scored[_KEY].merge(found, on=_KEY, how="left").set_axis(scored.index)
    # No score is on common pixels that are not known, whatever a bundle says: `verify` does not compute it again.
    new.loc[~scored["_kind"].isin(["common", "none"]), ["status", "reason"]] = None
    new.loc[scored["_kind"] == "none", _RESULT] = [*_NOTHING, Reason.NO_SHARED_PIXELS.value]
    # Of one score of a view, either all methods are on common pixels or none.
    is_absent = Reason.among(new["reason"].fillna(""), Reason.NOT_STORED, Reason.NOT_HELD)
    lacks = new["status"].isna() | is_absent
    why = new["reason"].fillna(scored["_why"]).where(lacks)
    score = [scored[name] for name in _SCORE]
    lacks, why = lacks.groupby(score).transform("any"), why.groupby(score).transform("first")
    placed = scored.index[~lacks]
    for name in _RESULT:
        rows.loc[placed, name] = new.loc[placed, name].astype(rows[name].dtype)
    rows.loc[placed, "pixels"] = "common"
    rows.loc[scored.index, "pixels_share"] = scored["_share"].astype(float)
    rows.loc[scored.index[lacks], "pixels_reason"] = why[lacks]
    return rows


def among(rows: DataFrame, others: DataFrame, columns: list[str]) -> npt.NDArray[np.bool_]:
    """Return which rows have the same values of these columns as one of the others."""
    import pandas as pd

    known = pd.MultiIndex.from_frame(others[columns])
    return np.asarray(pd.MultiIndex.from_frame(rows[columns]).isin(known))


def _views(whole: DataFrame, common: DataFrame) -> DataFrame:
    """What is known of each view that methods fill differently. whole: the views' restorations.

    `_kind`: "common", "none" or "unknown" of `sucre_bench.results.common_scores.Kind`; `_mask`: hash of the common
    mask; `_share`: of the image that it has; `_why`: why it is not known. A view in the table of common scores counts
    only if it covers all methods and their newest results.
    """
    import pandas as pd

    said = tuples(common[common["metric"] == COMMON_PIXELS])
    told = {(about.dataset, about.scene, about.view): about for about in said}  # the last
    by_view = whole.groupby(_VIEW).agg(
        low=("coverage", "min"),
        high=("coverage", "max"),
        by=("method", set),
        last=("time", "max"),
    )
    states = []
    for view, low, high, methods, last in by_view.itertuples(name=None):
        if low == 1 or len(methods) == 1:
            continue
        about = told.get(view)
        if about and (methods - methods_of(about.options) or about.time < last):
            about = None  # of fewer methods, or older than a result
        if about:
            kind = kind_of(about.status, about.code)
            if kind != "equal":
                states.append(
                    (*view, kind, about.code, about.value, about.reason or NOT_SCORED)
                )
        elif high - low > LEAST_DIFFERENCE:
            states.append((*view, "unknown", "", math.nan, NOT_SCORED))
    return pd.DataFrame(states, columns=[*_VIEW, "_kind", "_mask", "_share", "_why"])


def scores_of_pixels(rows: DataFrame) -> Series:
    """Return which rows are scores of whole images by metrics that rank pictures by their pixels.

    A metric that is not installed does not.
    """
    of_pixels = [name for name, plugin in metrics_in(rows).items() if plugin.is_of_pixels]
    return rows["metric"].isin(of_pixels) & (rows["region"] == "image")
