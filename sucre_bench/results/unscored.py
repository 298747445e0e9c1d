"""Scores that views could not give, together by their reason."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from sucre_bench.arrays import DataFrame
from sucre_bench.results.reasons import Reason, brief
from sucre_bench.results.rows import score_rows, values_of

_VIEW = ["dataset", "scene", "view"]


@dataclass(frozen=True)
class Unscored:
    """Scores that are missing for one reason.

    metrics: their names, with the variants if others are there; methods: whose, empty for all; views: dataset, scene
    and name of each, empty for all; datasets, n_views: of the whole table.
    """

    reason: str
    metrics: tuple[str, ...]
    methods: tuple[str, ...]
    views: tuple[tuple[str, str, str], ...]
    n_views: int
    datasets: tuple[str, ...]
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
    skipped = score_rows(rows[rows["status"] == "skipped"])
    if not with_nothing_to_score:
        skipped = skipped[skipped["reason"] != Reason.NOTHING_TO_SCORE.value]
    n_views, n_methods = len(rows.loc[rows["view"] != "", _VIEW].drop_duplicates()), rows["method"].nunique()
    briefs = {text: brief(text) for text in skipped["reason"].unique()}
    for reason, of_reason in skipped.groupby(skipped["reason"].map(briefs), sort=False):
        metrics = (_with_variants(name, scores, rows) for name, scores in of_reason.groupby("metric", sort=False))
        methods = tuple(dict.fromkeys(of_reason["method"]))
        views = tuple(values_of(of_reason[_VIEW].drop_duplicates(), *_VIEW))
        yield Unscored(
            str(reason),
            tuple(metrics),
            methods if len(methods) < n_methods else (),
            views if len(views) < n_views else (),
            n_views,
            tuple(rows["dataset"].unique()),
            all(Reason.of(text) is Reason.LACK for text in of_reason["reason"].unique()),
        )


def _with_variants(metric: Any, lost: DataFrame, rows: DataFrame) -> str:
    """A metric's name, with the variants that are lost where others are not."""
    variants = list(dict.fromkeys(lost["variant"]))
    every = rows.loc[rows["metric"] == metric, "variant"].nunique()
    return str(metric) if len(variants) == every else f"{metric} ({', '.join(variants)})"
