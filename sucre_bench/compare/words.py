"""The words of a comparison in every format: numbers, cells, legend, notes, verdicts, and its answer.

`answer` says in a few sentences what is wrong with pictures, and who is ahead by each score.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from sucre_bench.arrays import DataFrame
from sucre_bench.compare.model import (
    FEWEST_FOR_LEAD,
    FEWEST_VIEWS,
    METRICS,
    Column,
    Comparison,
    Verdict,
    may_be_chance,
)
from sucre_bench.machine.text_formats import first_few
from sucre_bench.plugins.plugin import Role
from sucre_bench.results.rows import PREFERENCE, RESTORATION

# How numbers are rounded: decimals from what size on, the largest first; figures of smaller ones, and from what size on
# these are written as 1.2e-05.
_DECIMALS = ((100, 0), (10, 1), (1, 2), (0.1, 3))
_FIGURES = 2
NUMBERS = {"decimals": _DECIMALS, "figures": _FIGURES, "scientific_below": 1e-4}

ARROW = {"higher": "↑", "lower": "↓", "none": ""}

_MOST_NAMES = 4


def number(value: float) -> str:
    """Return three figures, two below 0.1 (see `NUMBERS`); "-" for NaN."""
    if math.isnan(value):
        return "-"
    size = abs(value)
    for least, decimals in _DECIMALS:
        if size >= least:
            return f"{value:.{decimals}f}"
    return f"{value:#.{_FIGURES}g}" if size else "0"


def signed(value: float) -> str:
    """A number that says that it is a difference: "+0.31"."""
    return f"+{number(value)}" if value > 0 else number(value)


def title(column: Column) -> str:
    """A metric's name with its direction and unit."""
    return " ".join(filter(None, [column.metric, ARROW[column.better], column.unit]))


def _is_one_of_several(comparison: Comparison, column: Column) -> bool:
    """Whether a table has several variants of a column's metric."""
    return [one.metric for one in comparison.columns].count(column.metric) > 1


# -- cells -------------------------------------------------------------------------------------------------


Look = Literal["", "best", "second", "better", "worse", "dim"]
_PLACES: Mapping[int, Look] = {1: "best", 2: "second"}
_LOOKS: Mapping[Look, str] = {
    "best": "bold: best",
    "second": "underlined: second",
    "better": "bold: better",
}


@dataclass(frozen=True)
class Shown:
    """The parts of a cell, each "" where there is none."""

    value: str

    mark: str = ""
    """It is "≈" if the score is no different by more than chance, where others are."""

    interval: str = ""
    """With its brackets."""

    holes: str = ""
    """As "○" and how many."""

    look: Look = ""
    """What sets it apart: "best", "second", with a baseline "better", "worse"; "dim" where nobody wins."""

    def __str__(self) -> str:
        return " ".join(filter(None, [self.mark, self.value, self.interval, self.holes]))


def shown(comparison: Comparison, method: str, column: Column, spread: bool = False) -> Shown:
    """Return what a cell shows; spread: with the standard deviation. "-" where a method has nothing."""
    cell = comparison.cells.get((method, column))
    if cell is None:
        return Shown("-")
    look: Look = "dim" if column.knows == "taste" else ""
    holes = f"○{cell.holes}" if cell.holes else ""
    mark = ""
    if not math.isnan(cell.change[0]):
        change, low, high = cell.change
        is_chance = may_be_chance(cell.change)
        if change and is_chance:
            mark = "≈"
        elif column.ranked and math.isfinite(low) and not is_chance:
            look = "better" if change * column.sign < 0 else "worse"
        interval = f"[{signed(low)}, {signed(high)}]" if math.isfinite(low) else ""
        return Shown(signed(change), mark, interval, holes, look)
    value = number(cell.mean)
    if spread and not math.isnan(cell.std):
        value += f" ± {number(cell.std)}"
    behind = [other for other in comparison.of(column).values() if other.place > 1]
    if column.ranked and not comparison.baseline and behind:  # else there is no best
        look = _PLACES.get(cell.place, "")
        # where all tie, a sign would say "no difference" of gaps that are only too large for so few views
        mark = "≈" if cell.tie and not all(other.tie for other in behind) else ""
    interval = f"[{number(cell.low)}, {number(cell.high)}]" if math.isfinite(cell.low) else ""
    return Shown(value, mark, interval, holes, look)


@dataclass(frozen=True)
class Part:
    """A column of a table that is shown."""

    head: str
    """Lines that stand above it."""

    comparison: Comparison
    column: Column

    names: Mapping[str, str] = field(default_factory=dict)
    """What the comparison calls each method, where the table calls it otherwise."""


def parts_of(comparison: Comparison, with_variants: bool) -> list[Part]:
    """Return all columns of a comparison; with_variants: name variants also where a metric has only one."""
    parts = []
    for column in comparison.columns:
        is_named = with_variants or _is_one_of_several(comparison, column)
        below = column.unit
        if is_named:
            below = f"{column.variant} {column.unit}".strip()
        head = column.metric
        if column.is_share_filled:
            head = "filled"
        elif column.directed:
            head += f" {ARROW[column.better]}"
        parts.append(Part(f"{head}\n{below}", comparison, column))
    return parts


def shown_table(
    methods: Sequence[str],
    parts: Sequence[Part],
    spread: bool = False,
    intervals: bool = True,
) -> DataFrame:
    """Return the `Shown` cells of a table: a line a method and, last, over how many views the means are."""
    import pandas as pd

    columns: dict[int, list[Shown]] = {}
    for n, part in enumerate(parts):
        cells = [
            shown(part.comparison, part.names.get(name, name), part.column, spread)
            for name in methods
        ]
        if not intervals:
            cells = [replace(cell, interval="") for cell in cells]
        columns[n] = [*cells, Shown(str(part.column.n_views), look="dim")]
    table = pd.DataFrame(columns, index=[*methods, "views"], dtype=object)
    return table.set_axis([part.head for part in parts], axis="columns")


# -- below a table -----------------------------------------------------------------------------------------


def legend(comparison: Comparison, cells: DataFrame, spread: bool = False) -> str:
    """Say what the numbers and the marks of a table mean. cells: its `Shown`; spread: whether they show deviations."""
    every = cells.to_numpy().ravel()
    looks = {cell.look for cell in every}
    mean = "mean ± standard deviation" if spread else "mean"
    has_intervals = any(cell.interval for cell in every)
    if has_intervals:
        mean += " [95 % interval: bootstrap; of differences: step-down max-t]"
    reference = comparison.baseline or "the best"
    parts = [f"{mean} over views"]
    if comparison.baseline:
        parts = [f"with a sign: difference from {reference}", *parts]
    parts += [words for look, words in _LOOKS.items() if look in looks]
    has_marks = any(cell.mark for cell in every)
    if has_marks:
        parts.append(f"≈: the difference from {reference} may be chance")
    if any(cell.holes for cell in every):
        parts.append("○n: lacks n that others have")
    has_few_views = any(column.has_few_views for column in comparison.columns)
    if has_few_views and (has_intervals or has_marks):
        parts.append(f"intervals over fewer than {FEWEST_VIEWS} views are rough")
    if comparison.restorers:
        parts += [f"{name}: the photograph itself" for name in comparison.photographs]
    return "; ".join(parts)


def left_out(comparison: Comparison) -> list[str]:
    """Return a sentence for everything that the comparison does not count, with the reason."""
    said = []
    for note in comparison.notes:
        metrics = dict.fromkeys(column.metric for column in note.columns)
        if note.kind != "faults":
            said.append(note.text.replace(METRICS, first_few([*metrics], _MOST_NAMES)))
    return said


def verdict_text(comparison: Comparison, verdict: Verdict) -> str:
    """Return a verdict as a sentence: who is ahead, by how much, how steadily, and whether it may be chance."""
    column = verdict.column
    name = column.metric
    if _is_one_of_several(comparison, column):
        name += f" ({column.variant})"
    if column.plugin and column.knows == "evidence":
        pairs = 5 * (1 + column.plugin.agreement[column.variant])
        name = (
            f"By {name}, which agrees with true colours in {pairs:.0f} of 10 pairs of methods"
        )
    if not verdict.difference:
        return f"{name}: {verdict.leader} equals {verdict.second}"
    leads = "leads" if verdict.is_lead else "is ahead of"
    low, high = verdict.interval
    interval = f"[{number(low)}, {number(high)}]" if high < column.reach else ""
    by = " ".join(filter(None, [number(verdict.difference), column.unit, interval]))
    best = "better" if comparison.baseline else "best"
    chance = ""
    if verdict.may_be_chance:
        chance = ", which may be chance"
        if not interval:
            chance += f" (a track needs {FEWEST_VIEWS} views)"
    elif verdict.is_sure and not verdict.is_lead:
        chance = f", by more than chance (a lead needs {FEWEST_FOR_LEAD} views)"
    steadily = f"{best} in {round(verdict.wins, 1):g} of {column.n_views} views"
    return f"{name}: {verdict.leader} {leads} {verdict.second} by {by}, {steadily}{chance}"


# -- the answer: which columns decide, and who leads by each ---------------------------------------------------

_MOST = 4
# metrics that are evidence, and metrics that are taste, in a table without truth
_MOST_BLIND = 2
# Roles of scores that know the true colours, in the order in which metrics are taken and then shown.
_TRUE_COLOURS: tuple[Role, ...] = (
    "colours",
    "colours",
    "similarity",
    "chart-error",
    "similarity",
    "colour-difference",
)
# Roles of scores that follow where there is room: those of a plugin under test, say.
_OTHERS: frozenset[Role] = frozenset({"", "change-with-distance"})


@dataclass(frozen=True)
class Deciding:
    """The columns of a comparison that decide."""

    knows_colours: bool
    """False if no score compares with what is true, and nobody voted."""

    main: Column | None
    """The score that sorts the methods; None if no score shows which colours are true."""

    columns: tuple[Column, ...]
    """In the order of a table: behind the scores, the share of pixels with a colour, and seconds."""


def deciding(comparison: Comparison) -> Deciding:
    """Return the columns of a comparison that decide.

    Scores that know the true colours come first. Without any, people's votes, evidence and scores of the picture alone
    take their place, in this order.
    """
    once: dict[
        str, Column
    ] = {}  # the default variant of each metric, or the first that was scored
    for column in comparison.columns:
        is_default = column.plugin is not None and column.variant == column.plugin.default[0]
        if column.directed and (column.metric not in once or is_default):
            once[column.metric] = column
    left = [*once.values()]
    by_role = defaultdict[Role, list[Column]](list)
    for column in left:
        by_role[column.role].append(column)
    known = [by_role[role].pop(0) for role in _TRUE_COLOURS if by_role[role]][:_MOST]
    known.sort(key=lambda column: _TRUE_COLOURS.index(column.role))
    if not known:
        known = [column for column in left if column.metric == PREFERENCE]
        known += [column for column in left if column.knows == "evidence"][:_MOST_BLIND]
        of_picture = [column for column in left if column.role == "no-reference"]
        known += [column for column in of_picture if column.knows == "taste"][:_MOST_BLIND]
    others = [column for column in left if column not in known and column.role in _OTHERS]
    scores = (known + others or left)[:_MOST]
    scores.sort(key=lambda column: column.knows == "taste")
    knows = not scores or any(column.knows == "truth" for column in scores)
    main = next((column for column in scores if knows and column.ranked), None)
    beside = [c for c in comparison.columns if c.is_share_filled or c.metric == RESTORATION]
    beside = [column for column in beside if column not in scores]
    return Deciding(knows, main, (*scores, *beside))


def best_first(comparison: Comparison, main: Column | None) -> tuple[str, ...]:
    """Return the methods by their mean of a score, those without it behind them, photographs last; else as asked."""
    means: dict[str, float] = {}
    if main is not None:
        for name, cell in comparison.of(main).items():
            if not math.isnan(cell.mean):
                means[name] = main.sign * cell.mean
    apart = comparison.photographs if comparison.restorers else ()

    def place(name: str) -> tuple[bool, float]:
        return name in apart, means.get(name, math.inf)

    return tuple(sorted(comparison.methods, key=place))


def verdicts(comparison: Comparison) -> list[Verdict]:
    """Return the best method's lead over the second for each score; none for scores in which nobody leads.

    With a baseline: a verdict for each method and score, leader or second being the baseline.
    """
    judge = _differences_from_baseline if comparison.baseline else _lead_of_best
    return [
        verdict
        for column in comparison.columns
        if column.ranked
        for verdict in judge(comparison, column)
    ]


def _lead_of_best(comparison: Comparison, column: Column) -> Iterator[Verdict]:
    # the photograph has none
    cells = {name: cell for name, cell in comparison.of(column).items() if cell.place}
    if len(cells) < 2:
        return
    best, second = sorted(cells, key=lambda name: cells[name].place)[:2]
    behind = cells[second]
    gap, low, high = behind.behind
    if behind.place > 1 and math.isfinite(gap):
        yield Verdict(column, best, second, gap, (low, high), cells[best].wins)


def _differences_from_baseline(comparison: Comparison, column: Column) -> Iterator[Verdict]:
    baseline = comparison.baseline
    for name, cell in comparison.of(column).items():
        change, low, high = cell.change
        if not math.isfinite(change):
            continue
        interval = (low, high) if change > 0 else (-high, -low)
        if change * column.sign > 0:
            wins = column.n_views - cell.wins
            yield Verdict(column, baseline, name, abs(change), interval, wins)
        else:
            yield Verdict(column, name, baseline, abs(change), interval, cell.wins)


# The first and the last sentence where no score shows which colours are true.
BLIND = (
    "No score here compares with a chart or a reference: nobody can say from these numbers which colours are true.",
    "Look at the pictures, mark a chart (`sucre-bench charts`), or ask people (`study`).",
)


def answer(comparison: Comparison) -> list[str]:
    """Return a few sentences: what is wrong with the pictures, and a verdict for each score.

    With a baseline, there is a verdict for each method by the main score alone. Where no score shows which colours are
    true, the first sentence says that, and the last one what to do.
    """
    chosen = deciding(comparison)
    ranked = [column for column in comparison.columns if column.ranked]
    if comparison.baseline:
        ranked = [chosen.main] if chosen.main else ranked[:1]
    faults = [note for note in comparison.notes if note.kind == "faults"]
    said = []
    if faults:
        of_methods = "; ".join(f"{note.method}: {note.text}" for note in faults)
        said.append(f"What is wrong with the pictures: {of_methods}")
    judged = verdicts(replace(comparison, columns=tuple(ranked)))
    said += [verdict_text(comparison, verdict) for verdict in judged]
    for column in ranked:
        first = best_first(replace(comparison, photographs=()), column)[0]
        if first in comparison.photographs and comparison.restorers:
            said.append(f"{column.metric}: no method beats the photograph itself")
    return said if chosen.knows_colours else [BLIND[0], *said, BLIND[1]]
