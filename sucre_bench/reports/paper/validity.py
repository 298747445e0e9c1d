"""The figure "validity": how well each score orders methods as the study's first score does, over scenes.

The agreement is Kendall's tau-b between the two orders of the methods, in each view that both scored; the mean over a
scene's views, then over scenes. Scenes are the independent units of its 95 % interval (a bootstrap). The photograph is
left out: it competes with no method.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from sucre_bench.arrays import Array
from sucre_bench.compare import COSTS, Column, Comparison
from sucre_bench.errors import NotApplicableError
from sucre_bench.reports.paper import style
from sucre_bench.reports.paper.study_results import Drawn, StudyResults

_FEWEST_METHODS = 4
_DRAWS = 4000


@dataclass(frozen=True)
class Agreement:
    """tau: the mean over scenes; low, high: its 95 % interval, NaN over one scene; n_scenes: how many."""

    name: str
    tau: float
    low: float
    high: float
    n_scenes: int


def agreements(comparisons: Sequence[Comparison], truth: str) -> list[Agreement]:
    """Return the agreement of every score with a metric, best first. truth: "name" or "name:variant"."""
    by_score: dict[str, list[float]] = {}
    for table in comparisons:
        of_truth = [c for c in table.columns if truth in (c.metric, f"{c.metric}:{c.variant}")]
        for column in table.columns if of_truth else ():
            if column.directed and column != of_truth[0] and column.metric not in COSTS:
                found = by_score.setdefault(f"{column.metric}:{column.variant}", [])
                found += _of_scenes(table, column, of_truth[0])
    rng = np.random.default_rng(0)
    made = []
    for name, of_scenes in by_score.items():
        if of_scenes:
            taus, n = np.array(of_scenes), len(of_scenes)
            means = taus[rng.integers(0, n, (_DRAWS, n))].mean(axis=1)
            low, high = np.quantile(means, (0.025, 0.975)) if n > 1 else (np.nan, np.nan)
            made.append(Agreement(name, float(taus.mean()), float(low), float(high), n))
    return sorted(made, key=lambda each: -each.tau)


def _of_scenes(table: Comparison, column: Column, truth: Column) -> list[float]:
    """Return the mean tau of each scene of one table."""
    from scipy.stats import kendalltau

    one, other = table.measured.get(column), table.measured.get(truth)
    if one is None or other is None:
        return []
    names = [name for name in one.methods if name in other.methods and name not in table.photographs]
    taus: dict[str, list[float]] = {}
    for place, scores in zip(one.places, one.views, strict=True):
        if place not in other.places or len(names) < _FEWEST_METHODS:
            continue
        true: Array = other.views[other.places.index(place)]
        pairs = [(scores[one.methods.index(name)], true[other.methods.index(name)]) for name in names]
        tau = float(kendalltau(*zip(*pairs, strict=True)).statistic)
        if np.isfinite(tau):
            taus.setdefault(place[0], []).append(tau if column.better == truth.better else -tau)
    return [float(np.mean(of_scene)) for of_scene in taus.values()]


def validity(results: StudyResults) -> Iterator[Drawn]:
    """Draw the agreement of every score with the study's first metric, with its 95 % interval."""
    if not results.study.metrics:
        raise NotApplicableError("no metric to agree with; name it first in study.metrics")
    truth = results.study.metrics[0]
    found = agreements(results.comparisons, truth)
    if not found:
        raise NotApplicableError(f"no score to hold against {truth}; run {_FEWEST_METHODS} methods and other metrics")
    yield (), drawing(found, truth)


def drawing(found: Sequence[Agreement], truth: str) -> Figure:
    """Return the figure of these agreements, best on top."""
    figure, ((panel,),) = style.figure(1, 0.6 + 0.14 * len(found))
    for y, each in enumerate(found):
        panel.plot([each.low, each.high], [y, y], color="#0072B2", linewidth=1)
        panel.plot(each.tau, y, "o", color="#0072B2")
        panel.annotate(f"{each.tau:.2f}", (1.02, y), xycoords=("axes fraction", "data"), va="center", fontsize=6)
    panel.axvline(0, color="#888888", linewidth=0.6)
    panel.set_yticks(range(len(found)), [each.name for each in found])
    panel.set_ylim(len(found) - 0.4, -0.6)
    panel.grid(axis="x")
    scenes = max(each.n_scenes for each in found)
    panel.set_xlabel(f"Kendall's tau with {truth}, {scenes} scenes")
    return figure
