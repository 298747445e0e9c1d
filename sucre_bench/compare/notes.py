"""The notes of a comparison: what methods were trained on, lacking scores, pixels, faults of pictures."""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sucre_bench import plugins
from sucre_bench.arrays import DataFrame
from sucre_bench.compare.choose_rows import (
    metrics_of_faults,
    mixed_codes,
    options_of,
    scores_of_pixels,
)
from sucre_bench.compare.model import FILLED, Column, Note, NoteKind, says_filled
from sucre_bench.results.common_scores import LEAST_DIFFERENCE, LEAST_FILLED
from sucre_bench.results.reasons import Reason, without_view
from sucre_bench.results.rows import COSTS, RESTORATION, restoration_rows, restorations, values_of


@dataclass(frozen=True)
class About:
    """The methods of a dataset.

    notes: what each was trained on, which are this project's, and which changed between views; photographs: those that
    return the photograph itself; is_track: whether views lie along a track: views without poses have no order.
    """

    notes: tuple[Note, ...]
    photographs: frozenset[str]
    is_track: bool


def about(rows: DataFrame) -> About:
    """Return what is known of the methods of a dataset beside their scores. rows: with `_fresh`, see `is_fresh`."""
    options = options_of(rows)
    methods = {name: plugins.get("method", told.get("name", "")) for name, told in options.items()}
    data = [
        plugins.get("dataset", told.get("dataset", {}).get("name", "")) for told in options.values()
    ]
    trained = {name: told.get("trained_on") for name, told in options.items()}
    notes = [
        Note("trained on", (name,), reasons=str(text)) for name, text in trained.items() if text
    ]
    cites = {name: plugin.cites for name, plugin in methods.items() if plugin}
    for text in sorted(set(cites.values())):
        if text.startswith("by this project"):  # no published method
            names = tuple(name for name in cites if cites[name] == text)
            notes.append(Note("by us", names, reasons=text))
    for name, why in mixed_codes(rows[rows["_fresh"]]):
        notes.append(Note("mixed codes", (name,), reasons=why))
    return About(
        tuple(notes),
        frozenset(name for name, plugin in methods.items() if plugin and plugin.is_photograph),
        any(plugin is None or "poses" in plugin.has for plugin in data),
    )


REPETITION = ["scene", "view", "region", "_replicate"]

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
    restored: dict[str, set[_View]] = {}
    for name, *view in values_of(ok, "method", "scene", "view"):
        restored.setdefault(name, set()).add((view[0], view[1]))
    some = [name for name in methods if restored.get(name)]
    anywhere = set().union(*restored.values()) or {view for _, view in why.tried}
    everywhere = anywhere.intersection(*(restored[name] for name in some))
    for name in methods:
        lost = anywhere - restored.get(name, set())
        if lost:
            reasons = _counted(why(name, view) for view in lost)
            note = Note("no result", (name,), reasons=reasons)
            if name in some:
                note = replace(
                    note, kind="images lost", n=len(lost), total=len(anywhere), left=len(everywhere)
                )
            yield note
        yield from _scores_lost(name, lost, scores, repetitions, why)
    for column, values in scores.items():
        if column.n_units == 0:
            yield Note("nothing shared", tuple(map(str, values.columns)), (column,), unit=column.of)
    if not scores:  # why none of the requested metrics scored a method that did restore
        unscored = rows[rows["_asked"] & (rows["status"] != "ok")]
        for name in some:
            pairs = values_of(unscored[unscored["method"] == name], "status", "reason")
            yield Note("no score", (name,), reasons=_counted(map(": ".join, pairs)))
    if rows["_replicate"].nunique() > 1:
        yield from _repeats_lost(rows, repetitions)


@dataclass(frozen=True)
class _Why:
    """Why there is no restoration, or no score. Fields as for `notes`."""

    rows: DataFrame
    stale: Collection[Restored]

    @cached_property
    def _known(self) -> dict[tuple[str, str, str, _View], str]:
        """By method, metric, variant and view; made when something is missing that others have."""
        known: dict[tuple[str, str, str, _View], str] = {}
        lost = self.rows[self.rows["status"] != "ok"]
        columns = ("status", "reason", "scene", "view", "method", "metric", "variant")
        for status, reason, scene, view, *score in values_of(lost, *columns):
            text = f"{status}: {without_view(str(reason), view)}".rstrip(": ")
            known[*score, (scene, view)] = text
        return known

    @cached_property
    def tried(self) -> set[Restored]:
        """The methods that tried a view, whatever became of it."""
        restored = restoration_rows(self.rows)
        return {
            (method, (scene, view))
            for method, scene, view in values_of(restored, "method", "scene", "view")
        }

    def __call__(self, method: str, view: _View, column: Column | None = None) -> str:
        """Return why a method has no score of a view in a column, or no restoration of it."""
        whole = (RESTORATION, "wall")
        for metric, variant in ((column.metric, column.variant) if column else whole, whole):
            if text := self._known.get((method, metric, variant, view)):
                return text
        if (method, view) in self.tried:
            return "not scored"
        if (method, view) in self.stale:
            return "of other data"
        return self._known.get((method, *whole, ("", "")), "not run")  # the job failed as a whole


def _counted(reasons: Iterable[str]) -> str:
    """Reasons with how often they hold: those of one kind together, by the commonest of them."""
    kinds: dict[str, Counter[str]] = {}
    for reason in sorted(reasons):
        kind, _, why = reason.partition(": ")
        kinds.setdefault(kind, Counter())[why] += 1
    parts = []
    for kind, whys in kinds.items():
        why = whys.most_common(1)[0][0] + (" and others" if len(whys) > 1 else "")
        parts.append(f"{whys.total()} {kind}" + (f": {why}" if why else ""))
    return "; ".join(parts)


def _scores_lost(
    name: str, lost: set[_View], scores: _Tables, repetitions: _Tables, why: _Why
) -> Iterator[Note]:
    """A note for the metrics that lack the same units, apart from views that were not restored."""
    alike: dict[Note, list[Column]] = {}
    for column, values in scores.items():
        if column.metric in COSTS or name not in values or column.n_units == len(values):
            continue
        is_missing = values[name].isna()
        missing, there = (
            values.index[is_some].droplevel("region") for is_some in (is_missing, ~is_missing)
        )
        views = set(missing)
        if views <= lost:
            continue
        has_any = repetitions[column][name].dropna().index.droplevel(["region", "_replicate"])
        partly = (views & set(has_any)) - set(there)
        # some charts of a view
        concerned = list[_View](views)
        unit = column.of if views & set(there) else "image"
        counts = (len(views), len(values.index.droplevel("region").unique()), column.n_views)
        if views & set(there):
            concerned = [*missing]
            counts = (len(missing), len(values), column.n_units)
        reasons = _counted(
            "no repetition that all have" if v in partly else why(name, v, column)
            for v in concerned
        )
        alike.setdefault(
            Note("images lost", (name,), (), *counts, unit=unit, reasons=reasons), []
        ).append(column)
    yield from (replace(note, columns=tuple(columns)) for note, columns in alike.items())


def _repeats_lost(rows: DataFrame, repetitions: _Tables) -> Iterator[Note]:
    """Replicates that a method lacks, failed or never run, of images that have at least one other replicate.

    First those without a restoration, then those that only lack scores of some metrics.
    """
    whole = restoration_rows(rows[rows["view"] != ""])
    ok = (whole["status"] == "ok").groupby([whole[name] for name in (*REPETITION, "method")]).any()
    has: dict[Column | None, DataFrame] = {None: ok.unstack("method", fill_value=False)}
    has |= {
        column: values.notna()
        for column, values in repetitions.items()
        if column.metric not in COSTS
    }
    noted = ~has[None] & False
    alike = dict[tuple[Note, bool], list[Column]]()
    noted = noted.droplevel("region")
    for column, there in has.items():
        partly = ~there & there.groupby(level=REPETITION[:3]).transform("any")
        lost = partly.groupby(level=["scene", "view", "_replicate"]).any()
        if column is None:
            noted = lost
        else:
            lost &= ~noted.reindex(index=lost.index, columns=lost.columns, fill_value=False)
        for name, of_method in lost.loc[:, lost.any()].items():
            n = len(of_method.index[of_method].droplevel("_replicate").unique())
            note = Note(
                "replicates lost",
                (str(name),),
                n=n,
                total=len(of_method),
                lost=int(of_method.sum()),
            )
            alike.setdefault((note, column is None), []).extend([column] if column else [])
    yield from (replace(note, columns=tuple(columns)) for (note, _), columns in alike.items())


# -- pixels ------------------------------------------------------------------------------------------------


def filled_rows(rows: DataFrame) -> DataFrame:
    """Return rows of the share of the image that methods fill, if pictures are ranked and one has holes.

    rows: of one table, with `_asked`. No rows if the metric of coverage is among them.
    """
    asked = rows[rows["_asked"]]
    whole = restorations(rows)
    if not (whole["coverage"] < 1 - LEAST_DIFFERENCE).any() or not scores_of_pixels(asked).any():
        return whole.iloc[:0]
    if any(says_filled(*pair) for pair in set(values_of(asked, "metric", "variant"))):
        return whole.iloc[:0]
    about = {
        "metric": FILLED,
        "variant": "image",
        "unit": "share",
        "better": "none",
        "region": "image",
    }
    return whole.assign(**about, value=whole["coverage"])


def pixel_notes(rows: DataFrame, columns: Iterable[Column]) -> Iterator[Note]:
    """Yield on which pixels scores are that methods would have of different ones.

    rows: of one table, with `_asked` and the columns of `on_pixels`; columns: of the table.
    """
    whole = restorations(rows)
    scores = rows[rows["_asked"] & scores_of_pixels(rows)]

    def note(kind: NoteKind, concerned: DataFrame, **more: Any) -> Note:
        pairs = set(values_of(concerned, "metric", "variant"))
        named = tuple(column for column in columns if (column.metric, column.variant) in pairs)
        n, total = (len(set(values_of(some, "scene", "view"))) for some in (concerned, scores))
        return Note(kind, (), named, n, total, **more)

    none = Reason.among(scores["reason"], Reason.NO_SHARED_PIXELS)
    if len(common := scores[(scores["pixels"] == "common") & ~none]):
        share = float(common.drop_duplicates(["dataset", "scene", "view"])["pixels_share"].mean())
        yield note("common pixels", common, share=share)
    if none.any():
        yield note("no shared pixels", scores[none])
    # Scores on own pixels: with a reason, or of views of which methods fill shares that differ by much.
    filled = whole[whole["coverage"] >= LEAST_FILLED].groupby(["scene", "view"])["coverage"]
    differing = {*(filled.max() - filled.min()).loc[lambda share: share > LEAST_DIFFERENCE].index}
    is_differing = np.array(
        [view in differing for view in values_of(scores, "scene", "view")], dtype=bool
    )
    is_own = (is_differing & (scores["pixels"] == "own")) | (scores["pixels_reason"] != "")
    for reason, each in scores[is_own].groupby("pixels_reason", sort=False):
        made = note("own pixels", each, reasons=str(reason))
        if made.columns:  # a metric that lacks a reference, say, has none
            yield made


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
            bad = set(values_of(whole[is_bad], "scene", "view"))
            parts = values[[place in bad for place in values_of(values, "scene", "view")]]
            hues = parts["region"][parts["region"] != "image"].str.removeprefix("image/").mode()
            share = f"{100 * whole.loc[is_bad, 'value'].mean():.0f} %"
            words = fault.words.format(share=share, hue=hues.iloc[0] if len(hues) else "")
            said.append(words + (f" in {n} of {len(whole)} views" if n < len(whole) else ""))
        if said:
            yield Note("faults", (str(method),), reasons=", ".join(said))
