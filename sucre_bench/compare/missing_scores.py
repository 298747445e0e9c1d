"""The notes of a comparison: which method lacks which scores and why, on which pixels scores are, and what remains."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from sucre_bench import plugins
from sucre_bench.arrays import DataFrame, Series
from sucre_bench.compare.choose_pixels import scores_of_pixels
from sucre_bench.compare.model import FILLED, Column, Note, NoteKind, says_filled
from sucre_bench.results.common_scores import LEAST_DIFFERENCE, LEAST_FILLED
from sucre_bench.results.reasons import Reason, without_view
from sucre_bench.results.rows import COSTS, RESTORATION, restoration_rows, restorations, tuples, values_of

# More than this share of a picture without colour, or of its colours below zero, and a table says so.
_MUCH = 0.1

_IMAGE = ["dataset", "scene", "view"]
_REPETITION = ["scene", "view", "_replicate"]

_View = tuple[str, str]  # scene and view


def notes(
    rows: DataFrame,
    scores: Mapping[Column, DataFrame],
    repetitions: Mapping[Column, DataFrame],
    methods: Sequence[str],
) -> list[Note]:
    """Return what each method lacks that others have.

    rows: of the table, whatever became of them, with `_fresh` saying which are of the data compared, and `_replicate`;
    scores: the values of each column, units (scene, view, region) x methods, NaN = a hole; repetitions: the same before
    repetitions were averaged, with a level more, `_replicate`.
    """
    restored = _restored(rows)
    some = [name for name in methods if restored.get(name)]
    why = _Why(rows)
    anywhere = set().union(*restored.values()) or {view for _, view in why.tried}
    everywhere = anywhere.intersection(*(restored[name] for name in some))
    made: list[Note] = []
    for name in methods:
        lost = anywhere - restored.get(name, set())
        if lost and name not in some:
            made.append(Note("no result", (name,), reasons=why.restoration(name, lost)))
        elif lost:
            reasons = why.restoration(name, lost)
            made.append(Note("images lost", (name,), (), len(lost), len(anywhere), len(everywhere), reasons=reasons))
        made += _scores_lost(name, lost, scores, repetitions, why)
    for column, values in scores.items():
        if column.n_units == 0:
            made.append(Note("nothing shared", tuple(map(str, values.columns)), (column,), unit=column.of))
    if not scores:
        made += _unscored(rows, some)
    return [*made, *_repeats_lost(rows, repetitions)]


def unlikely_pictures(rows: DataFrame) -> Iterator[Note]:
    """Yield which methods leave much of a picture without colour, and whose colours are often below zero.

    rows: of one table, with `_fresh`.
    """
    fresh = rows[rows["_fresh"] & (rows["status"] == "ok") & (rows["view"] != "")]
    whole = restoration_rows(fresh)
    yield from _often("holes", whole, 1 - whole["coverage"])
    of_any = {(name, p.default[0]) for name, p in plugins.usable("metric").items() if p.role == "negative"}
    negative = fresh.loc[[pair in of_any for pair in values_of(fresh, "metric", "variant")]]
    yield from _often("negative colours", negative, negative["value"])


def _often(kind: NoteKind, rows: DataFrame, shares: Series) -> Iterator[Note]:
    """A note on the methods of which a picture has too large a share, with the mean share of each, largest first."""
    by_method = shares.groupby(rows["method"]).agg(["mean", "max"])
    worst = by_method[by_method["max"] > _MUCH].sort_values("mean", ascending=False, kind="stable")["mean"]
    if len(worst):
        yield Note(kind, tuple(map(str, worst.index)), shares=tuple(map(float, worst)))


def _unscored(rows: DataFrame, methods: Iterable[str]) -> Iterator[Note]:
    """Why none of the requested metrics scored a method that did restore."""
    unscored = rows[rows["_asked"] & rows["_fresh"] & (rows["status"] != "ok")]
    for name in methods:
        why = [f"{r.status}: {r.reason}" for r in unscored[unscored["method"] == name].itertuples()]
        yield Note("no score", (name,), reasons=_counted(why))


def _restored(rows: DataFrame) -> dict[str, set[_View]]:
    """The views that each method restored."""
    ok = restoration_rows(rows[(rows["status"] == "ok") & rows["_fresh"]])
    return {str(name): set(values_of(of_method, "scene", "view")) for name, of_method in ok.groupby("method")}


_WHY = ("status", "reason", "scene", "view", "method", "metric", "variant")


@dataclass(frozen=True, eq=False)
class _Why:
    """Why there is no score, by method, metric, variant and view; of metric RESTORATION, no restoration."""

    rows: DataFrame

    @cached_property
    def known(self) -> dict[tuple[str, str, str, _View], str]:
        """Made when something is missing that others have."""
        known: dict[tuple[str, str, str, _View], str] = {}
        for r in tuples(self.rows[(self.rows["status"] != "ok") | ~self.rows["_fresh"]], *_WHY):
            reason = without_view(str(r.reason), r.view)
            text = f"{r.status}: {reason}".rstrip(": ") if r.status != "ok" else "of other data"
            known[r.method, r.metric, r.variant, (r.scene, r.view)] = text
        return known

    @cached_property
    def tried(self) -> set[tuple[str, _View]]:
        """The methods that tried a view, whatever became of it."""
        restored = restoration_rows(self.rows[self.rows["_fresh"]])
        return {(method, (scene, view)) for method, scene, view in values_of(restored, "method", "scene", "view")}

    def restoration(self, method: str, views: Iterable[_View]) -> str:
        return _counted(self._of_restoration(method, view) for view in views)

    def score(self, method: str, column: Column, views: Iterable[tuple[_View, bool]]) -> str:
        """views: and whether the method has a score there, of repetitions that not all have."""
        reasons = ((self.known.get((method, column.metric, column.variant, view)), view, has) for view, has in views)
        return _counted(
            "no repetition that all have" if has else text or self._of_restoration(method, view)
            for text, view, has in reasons
        )

    def _of_restoration(self, method: str, view: _View) -> str:
        if text := self.known.get((method, RESTORATION, "wall", view)):
            return text
        if (method, view) in self.tried:
            return "not scored"
        return self.known.get((method, RESTORATION, "wall", ("", "")), "not run")  # the job failed as a whole


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
    name: str,
    lost: set[_View],
    scores: Mapping[Column, DataFrame],
    repetitions: Mapping[Column, DataFrame],
    why: _Why,
) -> Iterator[Note]:
    """A note for the metrics that lack the same units, apart from views that were not restored."""
    alike: dict[Note, list[Column]] = {}
    for column, values in scores.items():
        if column.metric in COSTS or name not in values or column.n_units == len(values):
            continue
        missing = values.index[values[name].isna()].droplevel("region")
        views = set(missing)
        if not views or views <= lost:
            continue
        there = set(values.index[values[name].notna()].droplevel("region"))
        of_method = repetitions[column][name]
        partly = views & set(of_method.index[of_method.notna()].droplevel(["region", "_replicate"])) - there
        reasons = why.score(name, column, [(v, v in partly) for v in (missing if views & there else views)])
        if views & there:  # some charts of a view, not all
            key = Note("images lost", (name,), (), len(missing), len(values), column.n_units, 0, column.of, reasons)
        else:
            n = len(values.index.droplevel("region").unique())
            key = Note("images lost", (name,), (), len(views), n, column.n_views, reasons=reasons)
        alike.setdefault(key, []).append(column)
    yield from (replace(note, columns=tuple(columns)) for note, columns in alike.items())


def _repeats_lost(rows: DataFrame, repetitions: Mapping[Column, DataFrame]) -> Iterator[Note]:
    """Replicates that a method lacks, failed or never run, of images that have at least one other replicate."""
    whole = restoration_rows(rows[rows["_fresh"] & (rows["view"] != "")])
    keys = [whole[name] for name in (*_REPETITION, "method")]
    lost = _partly((whole["status"] == "ok").groupby(keys).any().unstack("method", fill_value=False), _REPETITION[:2])
    for name in lost.columns[lost.any()]:
        yield _replicates_lost(str(name), lost[name])
    alike: dict[Note, list[Column]] = {}
    for column, values in repetitions.items():
        if column.metric in COSTS or not values.isna().to_numpy().any():
            continue
        lacking = _partly(values.notna(), [*_REPETITION[:2], "region"]).groupby(level=_REPETITION).any()
        lacking &= ~lost.reindex(
            index=lacking.index, columns=lacking.columns, fill_value=False
        )  # the note above has these
        for name in lacking.columns[lacking.any()]:
            alike.setdefault(_replicates_lost(str(name), lacking[name]), []).append(column)
    yield from (replace(note, columns=tuple(columns)) for note, columns in alike.items())


def _partly(has: DataFrame, of: list[str]) -> DataFrame:
    """Tell which repetitions a method lacks while it has others. has: repetitions x methods; of: what is repeated."""
    return ~has & has.groupby(level=of).transform("any")


def _replicates_lost(name: str, lost: Series) -> Note:
    """lost: whether each replicate of an image is lost."""
    n = len(lost.index[lost].droplevel("_replicate").unique())
    return Note("replicates lost", (name,), n=n, total=len(lost), lost=int(lost.sum()))


def filled_rows(rows: DataFrame) -> DataFrame:
    """Return rows of the share of the image that methods fill, if pictures are ranked and one has holes.

    rows: of one table, with `_fresh` and `_asked`. No rows if the metric of coverage is among them.
    """
    asked = rows.loc[rows["_fresh"] & rows["_asked"], ["metric", "variant", "region"]]
    scored = asked[scores_of_pixels(asked)]
    if any(says_filled(*pair) for pair in _metrics(asked)):
        scored = scored.iloc[:0]
    whole = restorations(rows[rows["_fresh"]])
    if scored.empty or not (whole["coverage"] < 1 - LEAST_DIFFERENCE).any():
        return whole.iloc[:0]
    about = {"metric": FILLED, "variant": "image", "unit": "share", "better": "none", "region": "image"}
    return whole.assign(**about, value=whole["coverage"])


def _differing(restorations: DataFrame) -> set[tuple[str, str]]:
    """The views, by scene and name, of which methods fill shares that differ by more than `LEAST_DIFFERENCE`."""
    filled = restorations[restorations["coverage"] >= LEAST_FILLED].groupby(_IMAGE[1:])["coverage"]
    return set((filled.max() - filled.min()).loc[lambda share: share > LEAST_DIFFERENCE].index)


def pixel_notes(rows: DataFrame, columns: Iterable[Column]) -> list[Note]:
    """Return on which pixels scores are that methods would have of different ones.

    rows: of one table, with `_fresh` and `_asked`; columns: of the table.
    """
    import pandas as pd

    rows = rows if "pixels" in rows else rows.assign(pixels="own", pixels_share=math.nan, pixels_reason="")
    scores = rows[rows["_fresh"] & rows["_asked"] & scores_of_pixels(rows)]
    whole = restoration_rows(rows[rows["_fresh"] & (rows["status"] == "ok")])
    differing = _differing(whole)
    differs = [place in differing for place in _views(scores)] if differing else False
    is_own = pd.Series(differs, scores.index) & (scores["pixels"] == "own")
    none = scores["reason"] == Reason.NO_SHARED_PIXELS.value
    common = scores[(scores["pixels"] == "common") & ~none]

    def note(kind: NoteKind, concerned: DataFrame, **more: Any) -> Note:
        pairs = _metrics(concerned)
        named = tuple(column for column in columns if (column.metric, column.variant) in pairs)
        return Note(kind, (), named, len(set(_views(concerned))), len(set(_views(scores))), **more)

    made = []
    if len(common):
        made.append(note("common pixels", common, share=float(common.drop_duplicates(_IMAGE)["pixels_share"].mean())))
    if none.any():
        made.append(note("no shared pixels", scores[none]))
    reasons = scores["pixels_reason"].where(is_own | (scores["pixels_reason"] != ""))
    unshared = (note("own pixels", each, reasons=str(reason)) for reason, each in scores.groupby(reasons, sort=False))
    return made + [one for one in unshared if one.columns]  # a metric that lacks a reference, say, has no column


def _views(rows: DataFrame) -> list[tuple[str, str]]:
    return [*values_of(rows, "scene", "view")]


def _metrics(rows: DataFrame) -> set[tuple[str, str]]:
    """The metrics of rows, with their variants."""
    columns = ["metric", "variant"]
    return set(values_of(rows[columns].drop_duplicates(), *columns))
