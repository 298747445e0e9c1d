"""The notes of a comparison: what methods were trained on, lacking scores, pixels, faults of pictures."""

from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from sucre_bench import plugins
from sucre_bench.arrays import DataFrame
from sucre_bench.compare.choose_rows import (
    among,
    metrics_of_faults,
    mixed_codes,
    options_of,
    scores_of_pixels,
)
from sucre_bench.compare.model import FILLED, METRICS, Column, Note, says_filled
from sucre_bench.compare.words import number
from sucre_bench.machine.text_formats import counted
from sucre_bench.results.common_scores import LEAST_DIFFERENCE, filled_restorations
from sucre_bench.results.reasons import Reason, without_view
from sucre_bench.results.rows import (
    COSTS,
    RESTORATION,
    restoration_rows,
    restorations,
    values_of,
)


@dataclass(frozen=True)
class About:
    """The methods of a dataset."""

    notes: tuple[Note, ...]
    """What each was trained on, which are this project's, and which changed between views."""

    photographs: Collection[str]
    """Those that return the photograph itself."""

    is_track: bool
    """Whether views lie along a track: views without poses have no order."""


def about(rows: DataFrame) -> About:
    """Return what is known of the methods of a dataset beside their scores. rows: with `_fresh`, see `is_fresh`."""
    options = options_of(rows)
    methods = {
        name: plugins.get("method", told.get("name", "")) for name, told in options.items()
    }
    datasets = {told.get("dataset", {}).get("name", "") for told in options.values()}
    notes = [
        Note(f"{name} was trained on: {told['trained_on']}", "trained on")
        for name, told in options.items()
        if told.get("trained_on")
    ]
    by_us = defaultdict[str, list[str]](list)
    for name, plugin in methods.items():
        if plugin and plugin.cites.startswith("by this project"):  # no published method
            by_us[plugin.cites].append(name)
    notes += [Note(f"{', '.join(by_us[text])}: {text}") for text in sorted(by_us)]
    notes += map(Note, mixed_codes(rows[rows["_fresh"]]))
    photographs = {name for name, plugin in methods.items() if plugin and plugin.is_photograph}
    known = [plugins.get("dataset", name) for name in datasets]
    is_track = any(plugin is None or "poses" in plugin.has for plugin in known)
    return About(tuple(notes), photographs, is_track)


_VIEW = ["scene", "view"]
REPETITION = [*_VIEW, "region", "_replicate"]

_View = tuple[str, str]  # scene and view
Restored = tuple[str, _View]  # by a method
_Tables = Mapping[Column, DataFrame]


def notes(
    rows: DataFrame,
    scores: _Tables,
    repetitions: _Tables,
    methods: Sequence[str],
    stale: Collection[Restored],
) -> Iterator[Note]:
    """Yield what each method lacks that others have.

    rows: of the table, whatever became of them, with `_replicate`;
    scores: the values of each column, units (scene, view, region) x methods, NaN = a hole; repetitions: the same before
    repetitions were averaged, with a level more, `_replicate`; stale: what was restored from older data.
    """
    why = _Why(rows, stale)
    ok = restoration_rows(rows[rows["status"] == "ok"])
    restored = {
        name: {*values_of(each, "scene", "view")}
        for name, each in ok.groupby("method", sort=False)
    }
    anywhere = set().union(*restored.values()) or {view for _, view in why.tried}
    everywhere = anywhere.intersection(*restored.values())
    for name in methods:
        lost = anywhere - restored.get(name, set())
        if lost:
            reasons = _counted(why(name, view) for view in lost)
            text = f"{name} has no result ({reasons})"
            if name in restored:
                text = _lost(
                    name, "result", "image", len(lost), len(anywhere), len(everywhere), reasons
                )
            yield Note(text)
        yield from _scores_lost(name, lost, scores, repetitions, why)
    for column, values in scores.items():
        if column.n_scored == 0:
            text = f"{METRICS}: no {column.of} that {', '.join(values.columns)} all have"
            yield Note(text, columns=(column,))
    # why none of the requested metrics scored a method that did restore
    if all(column.metric == FILLED for column in scores):
        unscored = rows[rows["_asked"] & (rows["status"] != "ok")]
        for name in filter(restored.get, methods):
            pairs = values_of(unscored[unscored["method"] == name], "status", "reason")
            reasons = _counted(map(": ".join, pairs))
            yield Note(f"{name} has no score" + (f" ({reasons})" if reasons else ""))
    if rows["_replicate"].nunique() > 1:
        yield from _repeats_lost(rows, repetitions)


class _Why:
    """Why there is no restoration, or no score. rows, stale: as for `notes`."""

    def __init__(self, rows: DataFrame, stale: Collection[Restored]) -> None:
        self._stale = stale
        restored = values_of(restoration_rows(rows), "method", "scene", "view")
        self.tried = {(method, (scene, view)) for method, scene, view in restored}
        # By method, metric, variant and view.
        self._known: dict[tuple[str, str, str, _View], str] = {}
        columns = ("status", "reason", "scene", "view", "method", "metric", "variant")
        for status, reason, scene, view, *score in values_of(
            rows[rows["status"] != "ok"], *columns
        ):
            text = f"{status}: {without_view(str(reason), view)}".rstrip(": ")
            self._known[*score, (scene, view)] = text

    def __call__(self, method: str, view: _View, column: Column | None = None) -> str:
        """Return why a method has no score of a view in a column, or no restoration of it."""
        whole = (RESTORATION, "wall")
        for metric, variant in ((column.metric, column.variant) if column else whole, whole):
            if text := self._known.get((method, metric, variant, view)):
                return text
        if (method, view) in self.tried:
            return "not scored"
        if (method, view) in self._stale:
            return "of other data"
        # the job failed as a whole
        return self._known.get((method, *whole, ("", "")), "not run")


def _counted(reasons: Iterable[str]) -> str:
    """Reasons with how often they hold: those of one kind together, by the commonest of them."""
    kinds = defaultdict[str, Counter[str]](Counter)
    for reason in sorted(reasons):
        kind, _, why = reason.partition(": ")
        kinds[kind][why] += 1
    parts = []
    for kind, whys in kinds.items():
        why = whys.most_common(1)[0][0] + (" and others" if len(whys) > 1 else "")
        parts.append(f"{whys.total()} {kind}" + (f": {why}" if why else ""))
    return "; ".join(parts)


def _lost(name: str, what: str, unit: str, n: int, total: int, left: int, reasons: str) -> str:
    """What a method lacks in n of all units. left: those that remain for all methods."""
    rest = f"the other {left}" if n + left == total else f"the {left} that all have"
    compared = f"all are compared on {rest}" if left else "nothing is left to compare"
    return f"{name} has no {what} in {n} of {total} {unit}s ({reasons}): {compared}"


def _scores_lost(
    name: str, lost: set[_View], scores: _Tables, repetitions: _Tables, why: _Why
) -> Iterator[Note]:
    """A note for the metrics that lack the same units, apart from views that were not restored."""
    alike = defaultdict[str, list[Column]](list)
    for column, values in scores.items():
        if column.metric in COSTS or name not in values or column.n_scored == len(values):
            continue
        units = values.index.droplevel("region")
        is_missing = values[name].isna()
        concerned = [*units[is_missing]]
        views = set(concerned)
        if views <= lost:
            continue
        there = {*units[~is_missing]}
        has_any = repetitions[column][name].dropna().index.droplevel(["region", "_replicate"])
        partly = views.intersection(has_any) - there
        unit: str = column.of
        counts = (len(concerned), len(values), column.n_scored)
        if not views & there:  # else some charts of a view
            concerned = [*views]
            unit = "image"
            counts = (len(views), len(units.unique()), column.n_views)
        reasons = _counted(
            "no repetition that all have" if v in partly else why(name, v, column)
            for v in concerned
        )
        alike[_lost(name, METRICS, unit, *counts, reasons)].append(column)
    for text, columns in alike.items():
        yield Note(text, columns=tuple(columns))


def _repeats_lost(rows: DataFrame, repetitions: _Tables) -> Iterator[Note]:
    """Replicates that a method lacks, failed or never run, of images that have at least one other replicate.

    First those without a restoration, then those that only lack scores of some metrics.
    """
    whole = restoration_rows(rows[rows["view"] != ""])
    ok = (
        (whole["status"] == "ok")
        .groupby([whole[name] for name in (*REPETITION, "method")])
        .any()
    )
    unrestored = _partly_lost(ok.unstack("method", fill_value=False))
    yield from map(Note, _replicates(unrestored, ""))
    alike = defaultdict[str, list[Column]](list)
    for column, values in repetitions.items():
        if column.metric not in COSTS:
            lost = _partly_lost(values.notna())
            known = unrestored.reindex(index=lost.index, columns=lost.columns, fill_value=False)
            for text in _replicates(lost & ~known, f", of {METRICS}"):
                alike[text].append(column)
    for text, columns in alike.items():
        yield Note(text, columns=tuple(columns))


def _partly_lost(there: DataFrame) -> DataFrame:
    """Which replicates of a view each method lacks where it has others. there: by `REPETITION`, methods beside it."""
    lost = ~there & there.groupby(level=REPETITION[:3]).transform("any")
    return lost.groupby(level=["scene", "view", "_replicate"]).any()


def _replicates(lost: DataFrame, of_metrics: str) -> Iterator[str]:
    for name, of_method in lost.loc[:, lost.any()].items():
        images = counted(
            len(of_method.index[of_method].droplevel("_replicate").unique()), "image"
        )
        yield (
            f"{name} lacks {of_method.sum()} of {len(of_method)} repetitions, of {images}{of_metrics}: "
            "scores are means of those that all have"
        )


# -- pixels ------------------------------------------------------------------------------------------------


def filled_rows(rows: DataFrame) -> DataFrame:
    """Return rows of the share of the image that methods fill, if pictures are ranked and one has holes.

    rows: of one table, with `_asked`. No rows if the metric of coverage is among them.
    """
    asked = rows[rows["_asked"]]
    whole = restorations(rows)
    if (
        not (whole["coverage"] < 1 - LEAST_DIFFERENCE).any()
        or not scores_of_pixels(asked).any()
    ):
        return whole.iloc[:0]
    if any(says_filled(*pair) for pair in set(values_of(asked, "metric", "variant"))):
        return whole.iloc[:0]
    return whole.assign(
        metric=FILLED,
        variant="image",
        unit="share",
        better="none",
        region="image",
        value=whole["coverage"],
    )


def pixel_notes(rows: DataFrame, columns: Sequence[Column]) -> Iterator[Note]:
    """Yield on which pixels scores are that methods would have of different ones.

    rows: of one table, with `_asked` and the columns of `on_pixels`; columns: of the table.
    """
    scores = rows[rows["_asked"] & scores_of_pixels(rows)]
    total = len(scores[_VIEW].drop_duplicates())

    def concerned(some: DataFrame) -> tuple[tuple[Column, ...], str]:
        """The columns of some scores, and in how many images they are."""
        pairs = set(values_of(some, "metric", "variant"))
        n = len(some[_VIEW].drop_duplicates())
        named = tuple(column for column in columns if (column.metric, column.variant) in pairs)
        return named, f" in {n} of {total} images"

    none = Reason.among(scores["reason"], Reason.NO_SHARED_PIXELS)
    common = scores[(scores["pixels"] == "common") & ~none]
    everywhere = f" in {total} of {total} images"
    if len(common):
        named, where = concerned(common)
        share = number(100 * common.drop_duplicates(_VIEW)["pixels_share"].mean())
        text = f"{METRICS} on the pixels that all methods fill: {share} % of the image"
        yield Note(text + where.replace(everywhere, ""), "common pixels", columns=named)
    if none.any():
        named, where = concerned(scores[none])
        text = f"no score{where}, because they have no pixel that all methods fill"
        yield Note(text, columns=named)
    # Scores on own pixels: with a reason, or of views of which methods fill shares that differ by much.
    filled = filled_restorations(rows).groupby(_VIEW)["coverage"]
    difference = filled.max() - filled.min()
    differing = difference.index[difference > LEAST_DIFFERENCE]
    is_differing = scores.set_index(_VIEW).index.isin(differing)
    is_own = (is_differing & (scores["pixels"] == "own")) | (scores["pixels_reason"] != "")
    for reason, each in scores[is_own].groupby("pixels_reason", sort=False):
        named, where = concerned(each)
        why = f" ({reason})" if reason else ""
        text = f"{METRICS}{where.replace(everywhere, '')} on each method's own pixels, which differ{why}"
        if named:  # a metric that lacks a reference, say, has none
            yield Note(text, "own pixels", columns=named)


# A method has a fault if more than this share of its views has it.
_FEW = 0.2


# -- faults, in the words that metrics declare for them (`plugins.Fault`) ----------------------------------


def fault_notes(rows: DataFrame) -> Iterator[Note]:
    """Yield a note for each method whose pictures have faults. rows: of one table."""
    metrics = metrics_of_faults(rows)
    scored = rows[(rows["status"] == "ok") & rows["metric"].isin(metrics)]
    for method, of_method in scored.groupby("method", sort=False):
        said = []
        for (metric, variant), values in of_method.groupby(["metric", "variant"], sort=False):
            fault = metrics[str(metric)].get(str(variant))
            whole = values[values["region"] == "image"]
            if fault is None:
                continue
            is_bad = whole["value"] > fault.limit
            n = is_bad.sum()
            if n <= _FEW * len(whole):
                continue
            parts = values[among(values, whole[is_bad], _VIEW)]
            hues = parts["region"][parts["region"] != "image"].str.removeprefix("image/").mode()
            share = f"{100 * whole.loc[is_bad, 'value'].mean():.0f} %"
            words = fault.words.format(share=share, hue=hues.iloc[0] if len(hues) else "")
            said.append(words + (f" in {n} of {len(whole)} views" if n < len(whole) else ""))
        if said:
            yield Note(", ".join(said), "faults", str(method))
