"""Scores of all methods: a panel a metric, the best on top, with 95 % intervals.

A hollow dot is a method that is no different from the best by more than chance.
"""

import math
from collections.abc import Iterator
from typing import Any

from matplotlib.figure import Figure

from sucre_bench.compare import COSTS, Column, Comparison
from sucre_bench.compare.words import title
from sucre_bench.errors import NotApplicableError
from sucre_bench.jobs.run_options import Study
from sucre_bench.reports.paper.figures import style
from sucre_bench.reports.paper.study_results import StudyResults

_LINE = 0.135  # inches a method takes
_PAGE = 9.0  # inches a page has


def draw(results: StudyResults) -> Iterator[tuple[str, Figure]]:
    """Yield a figure per dataset, or more where the panels do not fit on a page."""
    comparisons = results.comparisons
    drawn = [(comparison, panels(comparison, results.study)) for comparison in comparisons]
    if not any(columns for _, columns in drawn):
        raise NotApplicableError("no scores that tell methods apart; add metrics, or method=a,b")
    for comparison, columns in drawn:
        most = 2 * max(1, int(_PAGE / _height(comparison)))
        for start in range(0, len(columns), most):
            page = str(start // most + 1) if len(columns) > most else ""
            words = (comparison.title if len(comparisons) > 1 else "", page)
            yield "-".join(filter(None, words)), _figure(comparison, columns[start : start + most])


def panels(comparison: Comparison, study: Study) -> list[Column]:
    """Return the columns worth a panel: what tells methods apart, but of costs only those that the study names."""
    named = {metric.partition(":")[0] for metric in study.metrics}
    chosen = (c for c in comparison.columns if c.directed or (c.metric in COSTS and c.metric in named))
    return [column for column in chosen if _tells(comparison, column)]


def _tells(comparison: Comparison, column: Column) -> bool:
    """Whether methods have scores, and not all of them the same."""
    means = {cell.mean for (_, scored), cell in comparison.cells.items() if scored == column}
    n_scored = sum(scored == column for _, scored in comparison.cells)
    return len(means) > 1 or n_scored == 1


def _height(comparison: Comparison) -> float:
    """Inches that a panel takes."""
    return 0.55 + _LINE * len(comparison.methods)


def _figure(comparison: Comparison, columns: list[Column]) -> Figure:
    figure, axes = style.grid(len(columns), min(len(columns), 2), 0.0, _height(comparison))
    looks = style.looks(comparison.methods)
    for column, panel in zip(columns, axes.flat, strict=False):
        _panel(panel, comparison, column, looks)
    return figure


def _panel(panel: Any, comparison: Comparison, column: Column, looks: dict[str, style.Look]) -> None:
    scored = [(cell.place, name, cell) for name in comparison.methods if (cell := comparison.cells.get((name, column)))]
    scored.sort(key=lambda one: one[0] or math.inf)  # the photograph has no place
    for y, (_, method, cell) in enumerate(scored):
        look = looks[method]
        if math.isfinite(cell.low):
            panel.plot([cell.low, cell.high], [y, y], color=look.colour, linewidth=1, solid_capstyle="butt")
        if math.isfinite(cell.mean):
            face = "white" if cell.tie else look.colour
            panel.plot(cell.mean, y, look.marker, color=look.colour, markerfacecolor=face, markeredgewidth=0.9)
    panel.set_yticks(range(len(scored)), [method for _, method, _ in scored])
    panel.set_ylim(len(scored) - 0.4, -0.6)
    panel.tick_params(axis="y", length=0)
    panel.grid(axis="x")
    panel.set_xlabel(f"{title(column)} ({column.variant})")
    panel.spines["left"].set_visible(False)
