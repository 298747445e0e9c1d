"""Finds the scores of a bundle that nobody can verify: those of the restoration before it was rounded to 8 bits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from sucre_bench.engine.score import scorers
from sucre_bench.errors import ANY_FAULT
from sucre_bench.jobs.job import metric_choices
from sucre_bench.results.rows import COSTS
from sucre_bench.scene import Arrays, Restoration, View

if TYPE_CHECKING:
    import pandas as pd

_SIDE = 32  # pixels of the picture that metrics are tried on


def unverifiable(rows: pd.DataFrame) -> Mapping[str, int]:
    """Return how many scores of each metric need more than the restored image, by "metric:variant"."""
    scores = rows[(rows["status"] == "ok") & ~rows["metric"].isin(COSTS)]
    counts = scores.groupby(["metric", "variant"], sort=False, observed=True).size()
    return {f"{m}:{v}": int(n) for (m, v), n in counts.items() if _rests_on_unrounded(f"{m}:{v}")}


def _rests_on_unrounded(metric: str) -> bool:
    """Whether a score changes with the restoration while the restored image stays; False where that is not known."""
    rgb = np.linspace(0, 1, _SIDE * _SIDE * 3, dtype=np.float32).reshape(_SIDE, _SIDE, 3)
    view = View("a.png", Arrays(rgb, depth=np.ones((_SIDE, _SIDE), np.float32), reference=rgb[::-1]))
    try:
        (scorer,) = scorers(metric_choices([metric]))
        variant = metric.partition(":")[2]
        one, other = (
            [score.value for score in scorer.metric.score(Restoration(rgb - np.float32(darker)), rgb, view, variant)]
            for darker in (0, 0.5)
        )
    except ANY_FAULT:  # it is not registered here, or needs more than this view has
        return False
    return one != other
