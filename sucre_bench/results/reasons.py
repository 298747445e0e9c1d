"""Why a row has no value: the codes that begin the reasons of rows, and what lines say of them."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from typing import Any

from sucre_bench.arrays import DataFrame, Series
from sucre_bench.results.rows import RESTORATION


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


def unscored(rows: DataFrame, with_nothing_to_score: bool = False) -> Iterator[str]:
    """Yield a line for each reason why scores are skipped: "psnr of sucre in 3 of 9 views: needs reference".

    rows: of a score table; with_nothing_to_score: also scores of what a view or method does not have. If other scores
    have values, it needs no line that a method estimates no water, for example.
    """
    skipped = rows[(rows["status"] == "skipped") & (rows["metric"] != RESTORATION)]
    if not with_nothing_to_score:
        skipped = skipped[~Reason.among(skipped["reason"], Reason.NOTHING_TO_SCORE)]
    n_views = len(rows.loc[rows["view"] != "", _VIEW].drop_duplicates())
    n_methods = rows["method"].nunique()
    briefs = {text: brief(text) for text in skipped["reason"].unique()}
    for reason, lost in skipped.groupby(skipped["reason"].map(briefs), sort=False):
        metrics = [
            _with_variants(name, scores, rows)
            for name, scores in lost.groupby("metric", sort=False)
        ]
        methods = lost["method"].unique()
        n_lost = len(lost[_VIEW].drop_duplicates())
        of = f" of {', '.join(methods)}" if len(methods) < n_methods else ""
        where = f" in {n_lost} of {n_views} views" if n_lost < n_views else ""
        yield f"{', '.join(metrics)}{of}{where}: {reason}"


def _with_variants(metric: Any, lost: DataFrame, rows: DataFrame) -> str:
    """A metric's name, with the variants that are lost where others are not."""
    variants = list(dict.fromkeys(lost["variant"]))
    every = rows.loc[rows["metric"] == metric, "variant"].nunique()
    return str(metric) if len(variants) == every else f"{metric} ({', '.join(variants)})"
