"""Finds the scores of a bundle that nobody can verify: those of the restoration before it was rounded to 8 bits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from sucre_bench import plugins
from sucre_bench.engine.score import Scored, Scorer, scorers, variant_rows
from sucre_bench.errors import ANY_FAULT
from sucre_bench.jobs.job import metric_choices
from sucre_bench.results.rows import COSTS, Row
from sucre_bench.scene import Arrays, Restoration, View

if TYPE_CHECKING:
    import pandas as pd

_SIDE = 32  # pixels of the picture that metrics are tried on
_LIMIT_S = 60.0  # for a score of that picture
_HAS = frozenset({"depth", "reference", "restoration"})


def unverifiable(rows: pd.DataFrame) -> Mapping[str, int]:
    """Return how many scores of each metric need more than the restored image, by "metric:variant"."""
    scores = rows[(rows["status"] == "ok") & ~rows["metric"].isin(COSTS)]
    counts = scores.groupby(["metric", "variant"], sort=False, observed=True).size()
    return {f"{m}:{v}": int(n) for (m, v), n in counts.items() if _rests_on_unrounded(str(m), str(v))}


def _rests_on_unrounded(metric: str, variant: str) -> bool:
    """Whether a score changes with the restoration while the restored image stays, or the metric fails.

    False where that is not known: the metric is not registered here, or needs more than a view with depth and
    reference.
    """
    try:
        (scorer,) = scorers(metric_choices([f"{metric}:{variant}"]))
    except ANY_FAULT:
        return False
    if plugins.missing_needs(scorer.plugin, _HAS):
        return False
    one = _tried(scorer, variant, 0.0)
    other = one if _has_failed(one) else _tried(scorer, variant, 0.5)
    if _has_failed(other):
        return True
    return not np.array_equal([row.value for row in one], [row.value for row in other], equal_nan=True)


def _has_failed(rows: list[Row]) -> bool:
    return any(row.status == "failed" for row in rows)


def _tried(scorer: Scorer, variant: str, darker: float) -> list[Row]:
    """The rows of one restored image, with a restoration that is darker by so much than it."""
    rgb = np.linspace(0, 1, _SIDE * _SIDE * 3, dtype=np.float32).reshape(_SIDE, _SIDE, 3)
    view = View("a.png", Arrays(rgb, depth=np.ones((_SIDE, _SIDE), np.float32), reference=rgb[::-1]))
    scored = Scored(Restoration(rgb - np.float32(darker)), rgb, view)
    base = Row("trial", "", view.name, "trial", metric=scorer.plugin.name, variant=variant)
    return variant_rows(scorer.metric, scored, base, None, _LIMIT_S)
