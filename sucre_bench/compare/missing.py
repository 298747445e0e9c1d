"""What is missing in a comparison, in words: who lacks what, why, and what is left to compare on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sucre_bench.compare.model import Column
from sucre_bench.results.rows import COSTS

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["notes"]

_MOST_NAMES = 4

_REPETITION = ["scene", "view", "_replicate"]

_View = tuple[str, str]  # scene and view


def notes(
    rows: pd.DataFrame,
    scores: Mapping[Column, pd.DataFrame],
    repetitions: Mapping[Column, pd.DataFrame],
    methods: Sequence[str],
) -> list[str]:
    """Say what each method lacks that others have.

    rows: of the table, whatever became of them, with `_fresh` saying which are of the data compared, and `_replicate`;
    scores: the values of each column, units (scene, view, region) x methods, NaN = a hole; repetitions: the same before
    repetitions were averaged, with a level more, `_replicate`.
    """
    restored = _restored(rows)
    some = [name for name in methods if restored.get(name)]
    why = _Why.of(rows)
    anywhere = set().union(*restored.values()) or {view for _, view in why.tried}
    everywhere = anywhere.intersection(*(restored[name] for name in some))
    said = []
    for name in methods:
        lost = anywhere - restored.get(name, set())
        if lost and name not in some:
            said.append(f"{name} has no result ({why.restoration(name, lost)})")
        elif lost:
            reasons = why.restoration(name, lost)
            said.append(_sentence(name, "result", len(lost), len(anywhere), "image", reasons, len(everywhere)))
        said += _scores_lost(name, lost, scores, repetitions, why)
    for column, values in scores.items():
        if column.n_units == 0:
            said.append(f"{column.metric} ({column.variant}): no {column.of} that {_list(values.columns)} all have")
    if not scores:
        said += _unscored(rows, some)
    return [*said, *_repeats_lost(rows, repetitions)]


def _unscored(rows: pd.DataFrame, methods: Iterable[str]) -> Iterator[str]:
    """Why nothing that is asked for was scored, of methods that did restore."""
    own = rows[rows["_asked"] & rows["_fresh"] & (rows["status"] != "ok")]
    for name in methods:
        why = [f"{r.status}: {r.reason}" for r in own[own["method"] == name].itertuples()]
        yield f"{name} has no score" + (f" ({_counted(why)})" if why else "")


def _restored(rows: pd.DataFrame) -> dict[str, set[_View]]:
    """The views that each method restored."""
    ok = rows[(rows["metric"] == "seconds") & (rows["status"] == "ok") & rows["_fresh"]]
    return {str(name): set(zip(own["scene"], own["view"], strict=True)) for name, own in ok.groupby("method")}


@dataclass(frozen=True)
class _Why:
    """Why there is no score, by method, metric, variant and view; of metric "seconds", no restoration."""

    known: dict[tuple[str, str, str, _View], str]
    tried: set[tuple[str, _View]]

    @classmethod
    def of(cls, rows: pd.DataFrame) -> _Why:
        known = {}
        for r in rows[(rows["status"] != "ok") | ~rows["_fresh"]].itertuples():
            reason = str(r.reason).removeprefix(r.view).lstrip(" :")  # of several views, told as one
            text = f"{r.status}: {reason}".rstrip(": ") if r.status != "ok" else "of other data"
            known[r.method, r.metric, r.variant, (r.scene, r.view)] = text
        own = rows[(rows["metric"] == "seconds") & rows["_fresh"]]
        return cls(known, set(zip(own["method"], zip(own["scene"], own["view"], strict=True), strict=True)))

    def restoration(self, method: str, views: Iterable[_View]) -> str:
        return _counted(self._of_restoration(method, view) for view in views)

    def score(self, method: str, column: Column, views: Iterable[tuple[_View, bool]]) -> str:
        """views: and whether the method has a score there, of repetitions that not all have."""
        own = ((self.known.get((method, column.metric, column.variant, view)), view, has) for view, has in views)
        return _counted(
            "no repetition that all have" if has else text or self._of_restoration(method, view)
            for text, view, has in own
        )

    def _of_restoration(self, method: str, view: _View) -> str:
        if text := self.known.get((method, "seconds", "wall", view)):
            return text
        if (method, view) in self.tried:
            return "not scored"
        return self.known.get((method, "seconds", "wall", ("", "")), "not run")  # the job failed as a whole


def _counted(reasons: Iterable[str]) -> str:
    """Reasons with how often they hold: those of one kind together, by the commonest of them."""
    kinds: dict[str, Counter[str]] = {}
    for reason in sorted(reasons):
        kind, _, why = reason.partition(": ")
        kinds.setdefault(kind, Counter())[why] += 1
    said = []
    for kind, whys in kinds.items():
        why = whys.most_common(1)[0][0] + (" and others" if len(whys) > 1 else "")
        said.append(f"{whys.total()} {kind}" + (f": {why}" if why else ""))
    return "; ".join(said)


def _scores_lost(
    name: str,
    lost: set[_View],
    scores: Mapping[Column, pd.DataFrame],
    repetitions: Mapping[Column, pd.DataFrame],
    why: _Why,
) -> Iterator[str]:
    """A sentence for the metrics that lack the same, beyond what was not restored at all."""
    alike: dict[tuple[int, int, str, str, int], list[str]] = {}
    for column, values in scores.items():
        if column.metric in COSTS or name not in values or column.n_units == len(values):
            continue
        missing = values.index[values[name].isna()].droplevel("region")
        views = set(missing)
        if not views or views <= lost:
            continue
        there = set(values.index[values[name].notna()].droplevel("region"))
        own = repetitions[column][name]
        partly = views & set(own.index[own.notna()].droplevel(["region", "_replicate"])) - there
        reasons = why.score(name, column, [(v, v in partly) for v in (missing if views & there else views)])
        if views & there:  # some charts of a view, not all
            key = (len(missing), len(values), column.of, reasons, column.n_units)
        else:
            n = len(values.index.droplevel("region").unique())
            key = (len(views), n, "image", reasons, column.n_views)
        alike.setdefault(key, []).append(column.metric)
    for (n, of_all, noun, reasons, left), metrics in alike.items():
        yield _sentence(name, _list(dict.fromkeys(metrics)), n, of_all, noun, reasons, left)


def _sentence(name: str, what: str, n: int, of_all: int, noun: str, reasons: str, left: int) -> str:
    the_left = f"the other {left}" if n + left == of_all else f"the {left} that all have"
    on = f"all are compared on {the_left}" if left else "nothing is left to compare"
    return f"{name} has no {what} in {n} of {of_all} {noun}s ({reasons}): {on}"


def _list(names: Iterable[str]) -> str:
    names = list(names)
    more = len(names) - _MOST_NAMES
    return ", ".join(names) if more <= 1 else f"{', '.join(names[:_MOST_NAMES])} and {more} more"


def _repeats_lost(rows: pd.DataFrame, repetitions: Mapping[Column, pd.DataFrame]) -> Iterator[str]:
    """Repetitions that a method lacks, failed or never run, of images of which it has others."""
    whole = rows[(rows["metric"] == "seconds") & rows["_fresh"] & (rows["view"] != "")]
    keys = [whole[name] for name in (*_REPETITION, "method")]
    lost = _partly((whole["status"] == "ok").groupby(keys).any().unstack("method", fill_value=False), _REPETITION[:2])
    for name in lost.columns[lost.any()]:
        yield f"{name} lacks repetitions of {_of_images(lost[name])}"
    alike: dict[tuple[str, str], list[str]] = {}
    for column, values in repetitions.items():
        if column.metric in COSTS or not values.isna().to_numpy().any():
            continue
        own = _partly(values.notna(), [*_REPETITION[:2], "region"]).groupby(level=_REPETITION).any()
        own &= ~lost.reindex(index=own.index, columns=own.columns, fill_value=False)  # of which it is said already
        for name in own.columns[own.any()]:
            alike.setdefault((str(name), _of_images(own[name])), []).append(column.metric)
    for (method, images), metrics in alike.items():
        yield f"{method} lacks {_list(dict.fromkeys(metrics))} in repetitions of {images}"


def _partly(has: pd.DataFrame, of: list[str]) -> pd.DataFrame:
    """Tell which repetitions a method lacks while it has others. has: repetitions x methods; of: what is repeated."""
    return ~has & has.groupby(level=of).transform("any")


def _of_images(lost: pd.Series) -> str:
    n = len(lost.index[lost].droplevel("_replicate").unique())
    return f"{n} image{'s' * (n > 1)} ({lost.sum()} of {len(lost)}): scores are means of those that all have"
