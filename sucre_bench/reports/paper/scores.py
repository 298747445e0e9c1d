"""The figures of comparisons: scores (all methods by each metric), against (scores over the option of a study)."""

import math
from collections.abc import Iterator, Sequence

from matplotlib.figure import Figure

from sucre_bench.compare import COSTS, Cell, Column, Comparison
from sucre_bench.compare.words import title
from sucre_bench.errors import NotApplicableError
from sucre_bench.jobs.run_options import Study
from sucre_bench.reports.paper import style
from sucre_bench.reports.paper.study_results import Along, Drawn, StudyResults, Value

_LINE = 0.135  # inches a method takes
_PAGE = 9.0  # inches a page has
_LOG_FROM = 30  # greatest over least value
_NO_CELL = Cell(math.nan, math.nan, math.nan, math.nan, 0)


def scores(results: StudyResults) -> Iterator[Drawn]:
    """Draw the scores of all methods: a panel a metric, the best on top, with 95 % intervals.

    A hollow dot is a method that is no different from the best by more than chance. Yields a figure per dataset, or
    more where the panels do not fit on a page.
    """
    drawn = [(comparison, _telling(comparison, results.study)) for comparison in results.comparisons]
    if not any(columns for _, columns in drawn):
        raise NotApplicableError("no scores that tell methods apart; add metrics, or method=a,b")
    for comparison, columns in drawn:
        height = 0.55 + _LINE * len(comparison.methods)
        for page, shown in style.pages(columns, 2 * max(1, int(_PAGE / height))):
            yield (comparison.title if len(drawn) > 1 else "", page), _scores(comparison, shown, height)


def _telling(comparison: Comparison, study: Study) -> list[Column]:
    """The columns whose means differ between methods (or of one method); of costs only those that the study names."""
    named = {metric.partition(":")[0] for metric in study.metrics}
    columns = [c for c in comparison.columns if c.directed or (c.metric in COSTS and c.metric in named)]
    means = {c: [cell.mean for (_, scored), cell in comparison.cells.items() if scored == c] for c in columns}
    return [column for column in columns if len(means[column]) == 1 or len({*means[column]}) > 1]


def _scores(comparison: Comparison, columns: Sequence[Column], height: float) -> Figure:
    figure, panels = style.grid(len(columns), 2, 0.0, height)
    looks = style.looks(comparison.methods)
    for column, panel in zip(columns, panels, strict=True):
        scored = [(name, cell) for name in comparison.methods if (cell := comparison.cells.get((name, column)))]
        scored.sort(key=lambda each: each[1].place or math.inf)  # the photograph has no place
        for y, (method, cell) in enumerate(scored):
            colour, marker = looks[method]
            if math.isfinite(cell.low):
                panel.plot([cell.low, cell.high], [y, y], color=colour, linewidth=1, solid_capstyle="butt")
            if math.isfinite(cell.mean):
                face = "white" if cell.tie else colour
                panel.plot(cell.mean, y, marker, color=colour, markerfacecolor=face, markeredgewidth=0.9)
        panel.set_yticks(range(len(scored)), [method for method, _ in scored])
        panel.set_ylim(len(scored) - 0.4, -0.6)
        panel.tick_params(axis="y", length=0)
        panel.grid(axis="x")
        panel.set_xlabel(f"{title(column)} ({column.variant})")
        panel.spines["left"].set_visible(False)
    return figure


def against(results: StudyResults) -> Iterator[Drawn]:
    """Draw scores over the values of the study's option: a panel a metric, a line a method, bands are 95 % intervals.

    Values lie where their numbers are, on a logarithmic axis where they span more than a factor of 30; "all" or
    "none", being without limit, follows the greatest. Values that are words stand side by side. Yields a figure per
    dataset, or why there is none of it.
    """
    if not results.study.along:
        raise NotApplicableError("nothing to draw scores against; give study.along=degrade.NAME, say")
    for followed in results.followed:
        suffix, columns = followed.title if len(results.followed) > 1 else "", _telling(followed.scores, results.study)
        if len(followed.values) < 2:
            reason = f"{followed.title} has one value of {followed.option}; sweep over more"
            yield (suffix,), NotApplicableError(reason)
        elif not columns:
            reason = f"{followed.title} has no scores that differ between values of {followed.option}, or methods"
            yield (suffix,), NotApplicableError(f"{reason}; name others, study.metrics=[NAME]")
        else:
            yield (suffix,), _against(followed, columns)


def _against(followed: Along, columns: Sequence[Column]) -> Figure:
    figure, panels = style.grid(len(columns), 2, 0.5, 2.0, sharex=True)
    where, is_log = positions(followed.values)
    for column, panel in zip(columns, panels, strict=True):
        for method, (colour, marker) in style.looks(followed.methods).items():
            lines = [followed.lines[value, method] for value in followed.values]
            cells = [followed.scores.cells.get((line, column), _NO_CELL) for line in lines]  # a gap if there is none
            panel.plot(where, [cell.mean for cell in cells], color=colour, marker=marker, label=method)
            low, high = [cell.low for cell in cells], [cell.high for cell in cells]
            panel.fill_between(where, low, high, color=colour, alpha=0.12, linewidth=0)
        panel.set_ylabel(f"{title(column)} ({column.variant})")
        panel.grid(axis="y")
        if is_log:
            panel.set_xscale("log")
            panel.minorticks_off()
        panel.set_xticks(where, [value.word for value in followed.values])
    style.caption(figure, followed.axis, panels[0])
    return figure


def positions(values: Sequence[Value]) -> tuple[list[float], bool]:
    """Return where each value lies, and whether the axis is logarithmic."""
    numbers = sorted(value.number for value in values if value.number is not None)
    if len(numbers) < 2 or any(value.number is None for value in values if value.is_given):
        return [float(n) for n in range(len(values))], False
    least, before, greatest = numbers[0], numbers[-2], numbers[-1]
    is_log = least > 0 and greatest > _LOG_FROM * least
    beyond = greatest * greatest / before if is_log else 2 * greatest - before  # one step as long as the last
    return [beyond if value.number is None else value.number for value in values], is_log
