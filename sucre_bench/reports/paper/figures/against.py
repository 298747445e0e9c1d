"""Scores against the value that a study follows: a panel a metric, a line a method, bands are 95 % intervals.

Values lie where their numbers are, on a logarithmic axis where they span more than a factor of 30;
"all" or "none", being without limit, follows the greatest. Values that are words stand side by side.
"""

import math
from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure

from sucre_bench.compare import Column
from sucre_bench.compare.words import title
from sucre_bench.errors import NotApplicableError
from sucre_bench.reports.paper.figures import Drawn, style
from sucre_bench.reports.paper.figures.scores import panels
from sucre_bench.reports.paper.follow_option import Along, Value
from sucre_bench.reports.paper.study_results import StudyResults

_LOG_FROM = 30  # greatest over least value


def draw(results: StudyResults) -> Drawn:
    """Yield a figure per dataset, or why there is none of it."""
    if not results.study.along:
        raise NotApplicableError("nothing to draw scores against; give study.along=degrade.NAME, say")
    several = results.followed
    for followed in several:
        suffix, columns = followed.title if len(several) > 1 else "", panels(followed.scores, results.study)
        if len(followed.values) < 2:
            yield suffix, NotApplicableError(f"{followed.title} has one value of {followed.option}; sweep over more")
        elif not columns:
            reason = f"{followed.title} has no scores that differ between values of {followed.option}, or methods"
            yield suffix, NotApplicableError(f"{reason}; name others, study.metrics=[NAME]")
        else:
            yield suffix, _figure(followed, columns)


def positions(values: Sequence[Value]) -> tuple[list[float], bool]:
    """Return where each value lies, and whether the axis is logarithmic."""
    numbers = [value.number for value in values if value.number is not None]
    if len(numbers) < 2 or any(value.number is None for value in values if value.is_given):
        return [float(n) for n in range(len(values))], False
    least, greatest = min(numbers), max(numbers)
    is_log = least > 0 and greatest > _LOG_FROM * least
    before = sorted(numbers)[-2]
    beyond = greatest * greatest / before if is_log else 2 * greatest - before  # one step as long as the last
    return [beyond if value.number is None else value.number for value in values], is_log


def _figure(followed: Along, columns: list[Column]) -> Figure:
    wide = 2 if len(columns) > 1 else 1
    figure, axes = style.grid(len(columns), wide, 0.35, 2.0, sharex=True)
    looks = style.looks(followed.methods)
    where, is_log = positions(followed.values)
    for column, panel in zip(columns, axes.flat, strict=False):
        for method, look in looks.items():
            _line(panel, followed, method, column, where, look)
        panel.set_ylabel(f"{title(column)} ({column.variant})")
        panel.grid(axis="y")
        if is_log:
            panel.set_xscale("log")
            panel.minorticks_off()
        panel.set_xticks(where, [value.word for value in followed.values])
    for panel in axes[:, 0] if wide == 1 else _lowest(axes, len(columns)):
        panel.set_xlabel(followed.axis)
        panel.tick_params(labelbottom=True)
    style.legend_above(figure, axes[0, 0], 3 * wide)
    return figure


def _lowest(axes: Any, shown: int) -> list[Any]:
    """The last panel of each column that is shown."""
    return [axes.flat[max(n for n in range(shown) if n % axes.shape[1] == c)] for c in range(axes.shape[1])]


def _line(panel: Any, followed: Along, method: str, column: Column, where: Sequence[float], look: style.Look) -> None:
    """One method's means and the band of their intervals, with gaps where it has none."""
    cells = [followed.scores.cells.get((followed.line(value, method), column)) for value in followed.values]
    mean = [math.nan if cell is None else cell.mean for cell in cells]
    low = [math.nan if cell is None else cell.low for cell in cells]
    high = [math.nan if cell is None else cell.high for cell in cells]
    panel.plot(where, mean, color=look.colour, marker=look.marker, label=method)
    panel.fill_between(where, low, high, color=look.colour, alpha=0.12, linewidth=0)
