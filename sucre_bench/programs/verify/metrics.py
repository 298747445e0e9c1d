"""The registered metrics that score a bundle again, and which of them pictures are not enough for."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from sucre_bench import plugins
from sucre_bench.engine.score import Scorer, score_rows, scorers
from sucre_bench.errors import SucreBenchError
from sucre_bench.jobs.job import metric_choices
from sucre_bench.plugins.plugin import Plugin
from sucre_bench.results.restorations import Measured
from sucre_bench.results.rows import Row
from sucre_bench.scene import Restoration, View

__all__ = ["Metrics"]


class Metrics:
    """The registered metrics, made once each, and which of them the pictures are not enough for."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, str], Scorer | str] = {}
        self._unrounded: dict[tuple[str, str], bool] = {}

    def of(self, metric: str, variant: str) -> Scorer | str:
        """Return a metric in one variant, or why it cannot be used."""
        key = (metric, variant)
        if key not in self._known:
            self._known[key] = self._made(metric, variant)
        return self._known[key]

    def _made(self, metric: str, variant: str) -> Scorer | str:
        plugin = plugins.discover("metric").get(metric)
        if not isinstance(plugin, Plugin):
            return f"no metric {metric} is registered here"
        if plugin.is_of_pairs:
            return f"{metric} is of several restored views together"
        try:
            (made,) = scorers(metric_choices([f"{metric}:{variant}"]))
        except SucreBenchError:
            return f"{metric} has no variant {variant} here"
        return made

    def rests_on_unrounded(self, scorer: Scorer, row: Row, restoration: Restoration, view: View) -> bool:
        """Whether a score changes with the restoration while the restored image stays: the bundle has the latter."""
        key = (row.metric, row.variant)
        if key not in self._unrounded:
            other = replace(restoration, image=restoration.image - np.float32(0.5))
            again = score_rows(Measured(other, math.nan, math.nan), restoration.image, view, [scorer], Row())
            values = {one.region: one.value for one in again if one.metric == row.metric}
            self._unrounded[key] = not _equal(values.get(row.region, math.nan), row.value)
        return self._unrounded[key]


def _equal(one: float, other: float) -> bool:
    return one == other or (math.isnan(one) and math.isnan(other)) or math.isclose(one, other, rel_tol=1e-9)
