"""Why a row has no value: the codes that begin the reasons of rows, and what lines say of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any

from sucre_bench.arrays import DataFrame, Series
from sucre_bench.results.rows import RESTORATION, values_of


class Reason(Enum):
    """Kinds of reasons. The value is the code: a row's reason begins with it. What follows it is for people.

    The score table has no column of it. Nothing but `of` and `needs_of` looks at the text of a reason.
    """

    NOTHING_TO_SCORE = "nothing to score in this view"
    NO_VALUE = "no value (NaN)"
    NOT_STORED = "the computed image is not stored; save=full stores it"
    NOT_HELD = "compare_methods holds pictures, not computed images; sucre-bench run with save=full stores them"
    FILLS_LITTLE = "fills less than 1 % of the image"
    NO_SHARED_PIXELS = "no pixel that all methods fill"
    ONE_VIEW = "only one view of the scene is restored; two are needed"
    NO_OVERLAP = "no other restored view shows the same points"
    LACK = "needs "  # see `errors.Lack`
    DIED = "the process died "  # see `errors.DiedError`
    OTHER = ""

    @classmethod
    def of(cls, text: str) -> Reason:
        """Return the kind of a row's reason."""
        return next(reason for reason in cls if text.startswith(reason.value))

    @classmethod
    def among(cls, texts: Series, *kinds: Reason) -> Series:
        """Return which reasons of a column are of these kinds."""
        return texts.isin([text for text in texts.unique() if cls.of(text) in kinds])


def needs_of(text: str) -> tuple[str, ...]:
    """Return what a scene or view lacks, "depth" and "poses" say; empty for a reason of another kind."""
    if Reason.of(text) is not Reason.LACK:
        return ()
    needs = text.removeprefix(Reason.LACK.value).partition(": ")[0]
    needs = needs.partition(", the ")[0]  # in rows of earlier versions
    return tuple(needs.split(" and "))


def brief(text: str) -> str:
    """Return a row's reason without what differs between scenes: what is needed, not what there is."""
    needs = needs_of(text)
    return f"needs {' and '.join(needs)}" if needs else text


def with_remedy(text: str) -> str:
    """Return a row's reason, followed by the command that makes what is lacking, if there is one."""
    if text.startswith("ImportError: "):  # of a package that is there, but broken
        return f"{text}; install that package again"
    makes = [name for name in ("depth", "poses") if name in needs_of(text)]
    return f"{text}; `sucre-bench prepare` makes {' and '.join(makes)}" if makes else text


def without_view(text: str, view: str) -> str:
    """Return a reason without the view's name at its start, so that views with one reason count together."""
    starts_with_it = bool(view) and text.startswith((f"{view} ", f"{view}:"))
    return text.removeprefix(view).lstrip(" :") if starts_with_it else text


_VIEW = ["dataset", "scene", "view"]


@dataclass(frozen=True)
class Unscored:
    """Scores that are missing for one reason."""

    reason: str

    metrics: tuple[str, ...]
    """Their names, with the variants if others of the metric are not among them."""

    methods: tuple[str, ...]
    """Whose scores; empty for all."""

    views: tuple[tuple[str, str, str], ...]
    """Dataset, scene and name of each; empty for all."""

    n_views: int
    """Of the whole table."""

    datasets: tuple[str, ...]
    """Of the whole table."""

    is_lack: bool

    def __str__(self) -> str:
        where = f" in {len(self.views)} of {self.n_views} views" if self.views else ""
        of = f" of {', '.join(self.methods)}" if self.methods else ""
        is_everywhere = self.is_lack and not (self.views or self.methods)
        lack = f", which no view of {' or '.join(self.datasets)} has" if is_everywhere else ""
        return f"{', '.join(self.metrics)}{of}{where}: {self.reason}{lack}"


def unscored(rows: DataFrame, with_nothing_to_score: bool = False) -> Iterator[Unscored]:
    """Yield what is skipped of the scores, once for each reason.

    rows: of a score table; with_nothing_to_score: also scores of what a view or method does not have. If other scores
    have values, it needs no line that a method estimates no water, for example.
    """
    rows = rows[[*_VIEW, "method", "metric", "variant", "status", "reason"]]
    skipped = rows[(rows["status"] == "skipped") & (rows["metric"] != RESTORATION)]
    if not with_nothing_to_score:
        skipped = skipped[~Reason.among(skipped["reason"], Reason.NOTHING_TO_SCORE)]
    n_views = len(rows.loc[rows["view"] != "", _VIEW].drop_duplicates())
    n_methods = rows["method"].nunique()
    briefs = {text: brief(text) for text in skipped["reason"].unique()}
    for reason, of_reason in skipped.groupby(skipped["reason"].map(briefs), sort=False):
        metrics = (
            _with_variants(name, scores, rows)
            for name, scores in of_reason.groupby("metric", sort=False)
        )
        methods = tuple(dict.fromkeys(of_reason["method"]))
        views = tuple(values_of(of_reason[_VIEW].drop_duplicates(), *_VIEW))
        yield Unscored(
            str(reason),
            tuple(metrics),
            methods if len(methods) < n_methods else (),
            views if len(views) < n_views else (),
            n_views,
            tuple(rows["dataset"].unique()),
            all(map(needs_of, of_reason["reason"].unique())),
        )


def _with_variants(metric: Any, lost: DataFrame, rows: DataFrame) -> str:
    """A metric's name, with the variants that are lost where others are not."""
    variants = list(dict.fromkeys(lost["variant"]))
    every = rows.loc[rows["metric"] == metric, "variant"].nunique()
    return str(metric) if len(variants) == every else f"{metric} ({', '.join(variants)})"
