"""What tables of every format say: numbers, headings, the parts of a cell, legends, and sentences."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from sucre_bench.compare import Cell, Column, Comparison

__all__ = ["ARROW", "Shown", "left_out", "legend", "number", "shown", "signed", "title", "verdicts"]

ARROW = {"higher": "↑", "lower": "↓", "none": ""}


def title(column: Column) -> str:
    """A metric's name with its direction and unit."""
    return " ".join(filter(None, [column.metric, ARROW[column.better], column.unit]))


def number(value: float) -> str:
    """Three figures, two below 0.1; "-" for NaN."""
    if not math.isfinite(value):
        return "-" if math.isnan(value) else "inf" if value > 0 else "-inf"
    size = abs(value)
    for least, text in ((100, f"{value:.0f}"), (10, f"{value:.1f}"), (1, f"{value:.2f}"), (0.1, f"{value:.3f}")):
        if size >= least:
            return text
    return f"{value:#.2g}" if size else "0"


def signed(value: float) -> str:
    """A number that says that it is a difference: "+0.31"."""
    return f"+{number(value)}" if value > 0 else number(value)


# -- cells -------------------------------------------------------------------------------------------------


Look = Literal["", "best", "second", "better", "worse"]


@dataclass(frozen=True)
class Shown:
    """The parts of a cell, each "" where there is none.

    mark: "≈", no different by more than chance; interval: with its brackets; holes: "○" and how many; look: what sets
    it apart: "best", "second", or with a baseline "better", "worse".
    """

    mark: str
    value: str
    interval: str
    holes: str
    look: Look

    def __str__(self) -> str:
        return " ".join(filter(None, [self.mark, self.value, self.interval, self.holes]))


def shown(comparison: Comparison, method: str, column: Column, spread: bool = False) -> Shown:
    """Return what a cell shows; spread: with the standard deviation. "-" where a method has nothing."""
    cell = comparison.cells.get((method, column))
    if cell is None:
        return Shown("", "-", "", "", "")
    holes = f"○{cell.holes}" if cell.holes else ""
    if _is_change(cell):
        change, low, high = cell.change
        surely = low > 0 or high < 0
        is_better = (change > 0) == (column.better == "higher")
        look: Literal["", "better", "worse"] = "better" if is_better else "worse"
        mark = "≈" if low <= 0 <= high else ""
        return Shown(
            mark, signed(change), _interval(low, high, signed), holes, look if surely and column.ranked else ""
        )
    value = f"{number(cell.mean)} ± {number(cell.std)}" if spread else number(cell.mean)
    ranked = column.ranked and not comparison.baseline
    mark = "≈" if ranked and cell.tie else ""
    places: dict[int, Look] = {1: "best", 2: "second"}
    place = places.get(cell.place, "") if ranked and _differ(comparison, column) else ""
    return Shown(mark, value, _interval(cell.low, cell.high), holes, place)


def _differ(comparison: Comparison, column: Column) -> bool:
    """Whether there is a best: among several that are not all equal."""
    return any((cell := comparison.cells.get((name, column))) and cell.place > 1 for name in comparison.methods)


def _is_change(cell: Cell) -> bool:
    return not math.isnan(cell.change[0])


def _interval(low: float, high: float, word: Callable[[float], str] = number) -> str:
    return f"[{word(low)}, {word(high)}]" if math.isfinite(low) else ""


def blocks(widths: Sequence[int], room: int) -> Iterator[slice]:
    """Yield which columns stand beside each other, groups that each fit into `room` characters, two between columns."""
    start, left = 0, room
    for n, width in enumerate(widths):
        if n > start and width + 2 > left:
            yield slice(start, n)
            start, left = n, room
        left -= width + 2
    if widths:
        yield slice(start, len(widths))


# -- below a table -----------------------------------------------------------------------------------------


def legend(comparison: Comparison, spread: bool = False, colours: bool = False) -> str:
    """Say what the numbers of a table are, over what, what its marks mean, and how intervals are made.

    colours: whether the table tells better and worse by green and red, rather than better by bold.
    """
    if not comparison.columns:
        return "no scores"
    cells = [shown(comparison, name, column) for name in comparison.methods for column in comparison.columns]
    has_interval = any(cell.interval for cell in cells)
    looks = {cell.look for cell in cells}
    of = "mean" + (" ± standard deviation" if spread else "") + (" [95 % interval]" if has_interval else "")
    if comparison.baseline:
        of = (
            f"with a sign, the paired difference to {comparison.baseline}{' [95 % interval]' * has_interval}; else {of}"
        )
    said = [of, *_over(comparison)]
    said += ["bold: best, underlined: second"] * ("best" in looks)
    if looks & {"better", "worse"}:
        said.append("green: better, red: worse" if colours else "bold: better")
    if any(cell.mark for cell in cells):
        said.append(f"≈: no different from {comparison.baseline or 'the best'} by more than chance")
    said += ["○n: lacks n that others have"] * any(cell.holes for cell in cells)
    return "; ".join([*said, _how(comparison, has_interval)])


def _over(comparison: Comparison) -> Iterator[str]:
    """Over how many views: of most metrics, then of those that differ."""
    counts = Counter(_count(column) for column in comparison.columns if column.n_units)
    for number_, (count, _) in enumerate(counts.most_common()):
        names = [column.metric for column in comparison.columns if _count(column) == count]
        of = "over " if number_ == 0 else f"{', '.join(dict.fromkeys(names))} over "
        yield of + count


def _count(column: Column) -> str:
    views = f"{column.n_views} view{'s' * (column.n_views != 1)}"
    scenes = f" of {column.n_scenes} scenes" if column.n_scenes > 1 else ""
    charts = f" ({column.n_units} chart{'s' * (column.n_units != 1)})" if column.of == "chart" else ""
    return views + scenes + charts


def _how(comparison: Comparison, has_interval: bool) -> str:
    if not has_interval:
        return "no intervals: one view says nothing of chance"
    levels = [
        "scenes" * any(column.n_scenes > 1 for column in comparison.columns),
        "views",
        "charts" * any(column.of == "chart" for column in comparison.columns),
    ]
    return f"intervals: hierarchical bootstrap over {', '.join(filter(None, levels))}"


def left_out(comparison: Comparison) -> list[str]:
    """Say what the comparison does not count, and why."""
    return list(comparison.notes)


# -- sentences ---------------------------------------------------------------------------------------------


def verdicts(comparison: Comparison) -> list[str]:
    """Say for each score which method leads the next, and by how much; nothing where nobody leads.

    With a baseline: how each method differs from it.
    """
    say = _against_baseline if comparison.baseline else _leader
    return [sentence for column in comparison.columns if column.ranked for sentence in say(comparison, column)]


def _leader(comparison: Comparison, column: Column) -> Iterator[str]:
    ranked = [(cell, name) for name in comparison.methods if (cell := comparison.cells.get((name, column)))]
    ranked.sort(key=lambda pair: pair[0].place)
    if len(ranked) < 2:
        return
    (first, best), (next_, second) = ranked[:2]
    if next_.place == 1 or not math.isfinite(next_.behind[0]):
        return
    lead = f"{_name(comparison, column)}: {best} leads {second} by {_by(column, next_.behind)}"
    yield lead + _evidence(column, "best in", first.wins, next_.effect, next_.behind)


def _against_baseline(comparison: Comparison, column: Column) -> Iterator[str]:
    for name in comparison.methods:
        cell = comparison.cells.get((name, column))
        if cell is None or not math.isfinite(cell.change[0]):
            continue
        change, low, high = cell.change
        if not change:
            yield f"{_name(comparison, column)}: {name} equals {comparison.baseline}"
            continue
        is_better = (change > 0) == (column.better == "higher")
        by = (change, low, high) if change > 0 else (-change, -high, -low)
        than = f"is {'better' if is_better else 'worse'} than {comparison.baseline} by {_by(column, by)}"
        evidence = _evidence(column, "better in", cell.wins, cell.effect, by)
        yield f"{_name(comparison, column)}: {name} {than}{evidence}"


def _name(comparison: Comparison, column: Column) -> str:
    several = [c.metric for c in comparison.columns].count(column.metric) > 1
    return f"{column.metric} ({column.variant})" if several else column.metric


def _by(column: Column, difference: tuple[float, float, float]) -> str:
    gap, low, high = difference
    return " ".join(filter(None, [number(gap), column.unit, _interval(low, high)]))


def _evidence(column: Column, what: str, wins: float, effect: float, difference: tuple[float, float, float]) -> str:
    """In how many views, how large beside their spread, and whether it may be chance."""
    if column.n_views < 2:
        return ", on one view"
    size = f", effect {abs(effect):.1f}" if math.isfinite(effect) else ""
    chance = ", which may be chance" if difference[1] <= 0 else ""
    return f", {what} {round(wins, 1):g} of {column.n_views} views{size}{chance}"
