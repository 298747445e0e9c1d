"""The figures of comparisons: scores (all methods by each metric), against (scores over the option of a study), and
validity: how well each score orders methods as the study's first score does, over scenes.

The agreement of two scores is Kendall's tau-b between their orders of the methods, in each view that both scored. It is
the mean over a scene's views, then over scenes. Scenes are the independent units of its 95 % interval (a bootstrap).
The photograph is left out: it competes with no method.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes

from sucre_bench.arrays import DataFrame
from sucre_bench.compare import COSTS, Cell, Column, Comparison
from sucre_bench.compare.words import title
from sucre_bench.errors import NotApplicableError
from sucre_bench.jobs.run_options import Study
from sucre_bench.reports.paper import style
from sucre_bench.reports.paper.study_results import Drawn, StudyResults, Value

_LINE = 0.135  # inches a method takes
_PAGE = 9.0  # inches a page has
_LOG_FROM = 30  # greatest over least value
_NO_CELL = Cell(math.nan, math.nan, math.nan, math.nan, 0)


def scores(results: StudyResults) -> Iterator[Drawn]:
    """Draw the scores of all methods: a panel a metric, the best on top, with 95 % intervals.

    A hollow mark is a method that is no different from the best by more than chance; the figure says so. Yields a
    figure per dataset, or more where the panels do not fit on a page.
    """
    drawn = [
        (comparison, _telling(comparison, results.study)) for comparison in results.comparisons
    ]
    if not any(columns for _, columns in drawn):
        raise NotApplicableError(
            "no scores that tell methods apart; add metrics, or method=a,b"
        )
    for comparison, columns in drawn:
        height = 0.55 + _LINE * len(comparison.methods)
        for page, shown in style.pages(columns, 2 * max(1, int(_PAGE / height))):
            figure, panels = style.grid(len(shown), 2, 0.2, height)
            looks = style.looks(comparison.methods)
            for column, panel in zip(shown, panels, strict=True):
                scored = [
                    (name, comparison.cells[name, column])
                    for name in comparison.methods
                    if (name, column) in comparison.cells
                ]
                # the photograph has no place
                scored.sort(key=lambda each: each[1].place or math.inf)
                for y, (method, cell) in enumerate(scored):
                    colour, marker = looks[method]
                    face = "white" if cell.tie else colour
                    panel.plot([cell.low, cell.high], [y, y], color=colour, linewidth=1)
                    panel.plot(cell.mean, y, marker, color=colour, markerfacecolor=face)
                panel.set_yticks(range(len(scored)), [method for method, _ in scored])
                panel.set_ylim(len(scored) - 0.4, -0.6)
                panel.tick_params(axis="y", length=0)
                panel.grid(axis="x")
                panel.set_xlabel(f"{title(column)} ({column.variant})")
                panel.spines["left"].set_visible(False)
                _logarithmic(panel, column, [cell.mean for _, cell in scored])
            if any(cell.tie for (_, c), cell in comparison.cells.items() if c in shown):
                figure.supxlabel("hollow: the difference from the best may be chance")
            yield (comparison.title if len(drawn) > 1 else "", page), figure


def _logarithmic(panel: Axes, column: Column, means: Sequence[float]) -> None:
    """Give costs that span more than a factor of 30 a logarithmic axis."""
    least = min(means)
    if column.metric in COSTS and 0 < _LOG_FROM * least < max(means):
        panel.set_xscale("log")
        panel.set_xlim(left=least / 2)


def _telling(comparison: Comparison, study: Study) -> list[Column]:
    """The columns whose means differ between methods (or of one method); of costs only those that the study names."""
    named = {metric.partition(":")[0] for metric in study.metrics}
    columns = [
        c for c in comparison.columns if c.directed or (c.metric in COSTS and c.metric in named)
    ]
    telling = []
    for column in columns:
        means = [
            cell.mean for (_, scored), cell in comparison.cells.items() if scored == column
        ]
        known = [mean for mean in means if math.isfinite(mean)]
        if len(known) == 1 or len(set(known)) > 1:
            telling.append(column)
    return telling


def against(results: StudyResults) -> Iterator[Drawn]:
    """Draw scores over the values of the study's option: a panel a metric, a line a method, bands are 95 % intervals.

    Values lie where their numbers are, on a logarithmic axis where they span more than a factor of 30. "all" or "none",
    being without limit, follows the greatest. Values that are words stand side by side. Yields a figure per dataset, or
    why there is none of it.
    """
    if not results.study.along:
        raise NotApplicableError(
            "nothing to draw scores against; give study.along=degrade.NAME, say"
        )
    for followed in results.followed:
        suffix = followed.title if len(results.followed) > 1 else ""
        columns = _telling(followed.scores, results.study)
        if len(followed.values) < 2:
            reason = f"{followed.title} has one value of {followed.option}; sweep over more"
            yield (suffix,), NotApplicableError(reason)
            continue
        if not columns:
            reason = f"{followed.title} has no scores that differ between values of {followed.option}, or methods"
            yield (suffix,), NotApplicableError(f"{reason}; name others, study.metrics=[NAME]")
            continue
        figure, panels = style.grid(len(columns), 2, 0.5, 2.0, sharex=True)
        where, is_log = positions(followed.values)
        for column, panel in zip(columns, panels, strict=True):
            for method, (colour, marker) in style.looks(followed.methods).items():
                lines = [followed.lines[value, method] for value in followed.values]
                # a gap for none
                cells = [followed.scores.cells.get((line, column), _NO_CELL) for line in lines]
                panel.plot(
                    where,
                    [cell.mean for cell in cells],
                    color=colour,
                    marker=marker,
                    label=method,
                )
                low = [cell.low for cell in cells]
                high = [cell.high for cell in cells]
                panel.fill_between(where, low, high, color=colour, alpha=0.12, linewidth=0)
            panel.set_ylabel(f"{title(column)} ({column.variant})")
            panel.grid(axis="y")
            if is_log:
                panel.set_xscale("log")
                panel.minorticks_off()
            panel.set_xticks(where, [value.word for value in followed.values])
        style.caption(figure, followed.axis, panels[0])
        yield (suffix,), figure


def positions(values: Sequence[Value]) -> tuple[list[float], bool]:
    """Return where each value lies, and whether the axis is logarithmic."""
    numbers = sorted(value.number for value in values if value.number is not None)
    if len(numbers) < 2 or any(value.number is None for value in values if value.is_given):
        return [float(n) for n in range(len(values))], False
    least, before, greatest = numbers[0], numbers[-2], numbers[-1]
    is_log = least > 0 and greatest > _LOG_FROM * least
    # one step as long as the last
    beyond = greatest * greatest / before if is_log else 2 * greatest - before
    return [beyond if value.number is None else value.number for value in values], is_log


_FEWEST_METHODS = 4
_DRAWS = 4000


def agreements(comparisons: Sequence[Comparison], truth: str) -> DataFrame:
    """Return the agreement of every score with a metric, "name" or "name:variant", best first.

    The index has the scores; columns: tau, the mean over scenes; low and high, its 95 % interval, NaN over one scene;
    n_scenes.
    """
    import pandas as pd
    from scipy.stats import bootstrap

    by_score: dict[str, list[float]] = {}
    for table in comparisons:
        of_truth = [c for c in table.columns if truth in (c.metric, c.key)]
        for column in table.columns if of_truth else ():
            if column.directed and column != of_truth[0] and column.metric not in COSTS:
                found = by_score.setdefault(column.key, [])
                found += _of_scenes(table, column, of_truth[0])
    made: dict[str, tuple[float, ...]] = {}
    for name, taus in by_score.items():
        if len(taus) > 1:
            drawn = {"n_resamples": _DRAWS, "method": "percentile", "random_state": 0}
            low, high = bootstrap((taus,), np.mean, **drawn).confidence_interval
            made[name] = (float(np.mean(taus)), low, high, len(taus))
        elif taus:
            made[name] = (taus[0], math.nan, math.nan, 1)
    columns = ["tau", "low", "high", "n_scenes"]
    table = pd.DataFrame.from_dict(made, "index", columns=columns)
    return table.sort_values("tau", ascending=False, kind="stable")


def _of_scenes(table: Comparison, column: Column, truth: Column) -> list[float]:
    """Return the mean tau of each scene of one table."""
    import pandas as pd

    if column not in table.measured or truth not in table.measured:
        return []
    scores, true = (
        pd.DataFrame(
            known.views, pd.MultiIndex.from_tuples(known.places), columns=known.methods
        ).drop(columns=list(table.photographs), errors="ignore")
        for known in (table.measured[column], table.measured[truth])
    )
    scores, true = scores.align(true, join="inner")
    if len(scores.columns) < _FEWEST_METHODS:
        return []
    taus = scores.corrwith(true, axis=1, method="kendall")
    sign = 1 if column.better == truth.better else -1
    return (sign * taus.groupby(level=0).mean().dropna()).tolist()


def validity(results: StudyResults) -> Iterator[Drawn]:
    """Draw the agreement of every score with the study's first metric, with its 95 % interval."""
    if not results.study.metrics:
        raise NotApplicableError("no metric to agree with; name it first in study.metrics")
    truth = results.study.metrics[0]
    found = agreements(results.comparisons, truth)
    if found.empty:
        raise NotApplicableError(
            f"no score to hold against {truth}; run {_FEWEST_METHODS} methods and other metrics"
        )
    figure, ((panel,),) = style.figure(1, 0.6 + 0.14 * len(found))
    places = range(len(found))
    panel.hlines(places, found["low"], found["high"], color="#0072B2", linewidth=1)
    panel.plot(found["tau"], places, "o", color="#0072B2")
    panel.axvline(0, color="#888888", linewidth=0.6)
    panel.set_yticks(places, [f"{name}  {tau:.2f}" for name, tau in found["tau"].items()])
    panel.set_ylim(len(found) - 0.4, -0.6)
    panel.grid(axis="x")
    panel.set_xlabel(f"Kendall's tau with {truth}, {found['n_scenes'].max():.0f} scenes")
    yield (), figure
