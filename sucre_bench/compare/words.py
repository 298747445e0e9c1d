"""The words of a comparison in every format: numbers, headings, cells, legend, notes, verdicts, and its answer.

`answer` says in a few sentences who leads by the columns that decide (`deciding`), and what is wrong with pictures.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from sucre_bench.compare.model import (
    FEWEST_FOR_LEAD,
    FEWEST_VIEWS,
    METRICS,
    Column,
    Comparison,
    Note,
    Verdict,
    may_be_chance,
)
from sucre_bench.machine.text_formats import counted
from sucre_bench.plugins.plugin import Role
from sucre_bench.results.rows import PREFERENCE, RESTORATION

# How numbers are rounded: decimals from what size on, the largest first; figures of smaller ones, and from what size on
# these are written as 1.2e-05.
_DECIMALS = ((100, 0), (10, 1), (1, 2), (0.1, 3))
_FIGURES = 2
NUMBERS = {"decimals": _DECIMALS, "figures": _FIGURES, "scientific_below": 1e-4}

ARROW = {"higher": "↑", "lower": "↓", "none": ""}

_MOST_NAMES = 4
_ALIKE = 0.75  # of the views: if they are worth fewer independent ones, a table says so


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
    # memory is what a restoration adds to what its process held before
    name = "memory growth" if column.metric == "peak_mb" else column.metric
    return " ".join(filter(None, [name, ARROW[column.better], column.unit]))


def name_in(comparison: Comparison, column: Column) -> str:
    """A metric's name, with the variant if the table has several of it."""
    several = [c.metric for c in comparison.columns].count(column.metric) > 1
    return f"{column.metric} ({column.variant})" if several else column.metric


def listed(names: Iterable[str]) -> str:
    """Return names as text, at most four and how many more there are."""
    names = list(names)
    more = len(names) - _MOST_NAMES
    return (
        ", ".join(names) if more <= 1 else f"{', '.join(names[:_MOST_NAMES])} and {more} more"
    )


# -- cells -------------------------------------------------------------------------------------------------


Look = Literal["", "best", "second", "better", "worse"]
_PLACES: Mapping[int, Look] = {1: "best", 2: "second"}


@dataclass(frozen=True)
class Shown:
    """The parts of a cell, each "" where there is none."""

    mark: str
    """It is "≈" if the score is no different by more than chance, where others are."""

    value: str

    interval: str
    """With its brackets."""

    holes: str
    """As "○" and how many."""

    look: Look
    """What sets it apart: "best", "second", or with a baseline "better", "worse"."""

    def __str__(self) -> str:
        return " ".join(filter(None, [self.mark, self.value, self.interval, self.holes]))


def shown(comparison: Comparison, method: str, column: Column, spread: bool = False) -> Shown:
    """Return what a cell shows; spread: with the standard deviation. "-" where a method has nothing."""
    cell = comparison.cells.get((method, column))
    if cell is None:
        return Shown("", "-", "", "", "")
    holes = f"○{cell.holes}" if cell.holes else ""
    if not math.isnan(cell.change[0]):
        change, low, high = cell.change
        is_chance = may_be_chance(cell.change)
        mark = "≈" if change and is_chance else ""
        look: Look = ""
        if column.ranked and math.isfinite(low) and not is_chance:
            look = "better" if change * column.sign < 0 else "worse"
        return Shown(mark, signed(change), _interval(low, high, signed), holes, look)
    value = number(cell.mean)
    if spread and not math.isnan(cell.std):
        value += f" ± {number(cell.std)}"
    place: Look = ""
    mark = ""
    is_alone = all(c.place <= 1 for c in comparison.of(column).values())
    if column.ranked and not comparison.baseline and not is_alone:  # else there is no best
        place = _PLACES.get(cell.place, "")
        mark = "≈" if cell.tie else ""
    return Shown(mark, value, _interval(cell.low, cell.high), holes, place)


@dataclass(frozen=True)
class ShownColumn:
    """A column as it is shown."""

    head: str

    cells: list[Shown]
    """A cell a method."""

    unit: str = ""
    """The line below the heading."""

    is_dim: bool = False
    """Whether all of it is dim, because nobody wins by it."""


def shown_column(
    comparison: Comparison,
    column: Column,
    head: str,
    unit: str = "",
    spread: bool = False,
    intervals: bool = True,
) -> ShownColumn:
    """Return what a column shows of each method; spread: with standard deviations; intervals: whether it has them."""
    cells = [shown(comparison, name, column, spread) for name in comparison.methods]
    if not intervals:
        cells = [replace(cell, interval="") for cell in cells]
    return ShownColumn(head, cells, unit, column.knows == "taste")


def _interval(low: float, high: float, word: Callable[[float], str] = number) -> str:
    return f"[{word(low)}, {word(high)}]" if math.isfinite(low) else ""


# -- below a table -----------------------------------------------------------------------------------------


def over_views(columns: Sequence[Column]) -> list[str]:
    """Return over how many views the scores are: most views first, then the scores that have fewer, by name."""
    measured = [column for column in columns if column.n_scored]
    scores = [column for column in measured if column.ranked and not column.is_share_filled]
    told = {column.n_views for column in scores}
    scores += [column for column in measured if column.n_views not in told]
    alike = defaultdict[str, list[str]](list)
    for column in sorted(scores, key=lambda column: -column.n_views):
        scenes = f" of {column.n_scenes} scenes" if column.n_scenes > 1 else ""
        charts = (
            f" ({counted(column.n_scored, 'chart')})"
            if column.n_scored > column.n_views
            else ""
        )
        rough = ""
        if column.has_few_views:  # they do not show the distribution
            rough = ", no intervals" if column.n_views < 2 else ", intervals are rough"
        elif column.ranked and 0 < column.worth <= _ALIKE * column.n_views:
            rough = (
                f" (neighbours may be alike: worth {column.worth:.0f} independent ones or more)"
            )
        over = f"over {counted(column.n_views, 'view')}{scenes}{charts}{rough}"
        alike[over].append(column.metric)
    return [
        f"{listed(dict.fromkeys(names))}: {over}" if n else over
        for n, (over, names) in enumerate(alike.items())
    ]


def signs(comparison: Comparison, cells: Sequence[Shown], colours: bool = False) -> list[str]:
    """Return what the marks of cells mean. colours: whether better and worse are green and red, not bold."""
    looks = {cell.look for cell in cells}
    parts = []
    if "best" in looks:
        parts.append("bold: best, underlined: second" if "second" in looks else "bold: best")
    if looks & {"better", "worse"}:
        parts.append("green: better, red: worse" if colours else "bold: better")
    if any(cell.mark for cell in cells):
        parts.append(
            f"≈: the difference from {comparison.baseline or 'the best'} may be chance"
        )
    if any(cell.holes for cell in cells):
        parts.append("○n: lacks n that others have")
    photographs = comparison.photographs if comparison.restorers else ()
    how = ", which is judged alone" if comparison.baseline else ", which has no rank"
    return parts + [
        f"{name}: the photograph itself{'' if name == comparison.baseline else how}"
        for name in photographs
    ]


def legend(
    comparison: Comparison, spread: bool = False, colours: bool = False, intervals: bool = True
) -> str:
    """Say what the numbers of a table are, over what, what its marks mean, and how intervals are made.

    colours: whether the table tells better and worse by green and red, rather than better by bold; intervals: whether
    it shows them.
    """
    if not comparison.columns:
        return "no scores"
    baseline = comparison.baseline
    cells = [
        shown(comparison, name, column)
        for name in comparison.methods
        for column in comparison.columns
    ]
    has_interval = intervals and any(cell.interval for cell in cells)
    interval = " [95 % interval]" if has_interval else ""
    of = f"mean{' ± standard deviation' if spread else ''}{interval}"
    if baseline:
        judged = [cell.change[1] for cell in comparison.cells.values() if cell.change[0]]
        of_change = interval if any(map(math.isfinite, judged)) else ""
        of = f"with a sign: the difference from {baseline}{of_change}; else {of}"
    parts = [of, *over_views(comparison.columns), *signs(comparison, cells, colours)]
    if has_interval:
        units = (
            "scenes" if any(column.n_scenes > 1 for column in comparison.columns) else "views"
        )
        parts.append(f"intervals: bootstrap over {units}")
        scored = {name for name, column in comparison.cells if column.ranked}
        restorers = comparison.restorers or comparison.methods
        compared = {*restorers, *([baseline] if baseline else [])}
        n = len(scored & compared)
        if n > 2:
            of = f"differences from {baseline or 'the best'}"
            parts.append(f"of {of}: step-down max-t over {n} methods")
        elif n == 2 or (baseline and len(scored) > 1):
            parts.append("of the difference: Student's")
    return "; ".join(filter(None, parts))


def notes_once(comparisons: Sequence[Comparison]) -> list[Comparison]:
    """Return comparisons in which what is known of methods, whatever their scores, stands below the first alone."""
    said = set[Note]()
    made = []
    for comparison in comparisons:
        made.append(
            replace(comparison, notes=tuple(n for n in comparison.notes if n not in said))
        )
        said |= {note for note in comparison.notes if note.kind in ("by us", "trained on")}
    return made


def left_out(comparison: Comparison) -> list[str]:
    """Return a sentence for everything that the comparison does not count, with the reason."""
    return [
        note.text.replace(METRICS, listed(dict.fromkeys(one.metric for one in note.columns)))
        for note in comparison.notes
        if note.kind != "faults"
    ]


def faults(comparison: Comparison) -> list[str]:
    """Return a sentence that says what is wrong with the pictures of each method; none where nothing is."""
    said = "; ".join(
        f"{note.method}: {note.text}" for note in comparison.notes if note.kind == "faults"
    )
    return [f"What is wrong with the pictures: {said}"] if said else []


# -- verdicts ----------------------------------------------------------------------------------------------


def verdict_text(comparison: Comparison, verdict: Verdict, interval: bool = True) -> str:
    """Return a verdict as a sentence: who is ahead, by how much, how steadily, and whether it may be chance.

    With a baseline, the sentence is about the other method. interval: whether it has the interval and the effect.
    """
    column, baseline, views = verdict.column, comparison.baseline, verdict.column.n_views
    name = name_in(comparison, column)
    if column.plugin and column.knows == "evidence":
        pairs = 5 * (1 + column.plugin.agreement[column.variant])
        name = (
            f"By {name}, which agrees with true colours in {pairs:.0f} of 10 pairs of methods"
        )
    if baseline and not verdict.difference:
        return f"{name}: {verdict.leader} equals {verdict.second}"
    lead = f"{verdict.leader} {'leads' if verdict.is_lead else 'is ahead of'} {verdict.second}"
    wins = "best"
    if baseline == verdict.leader:
        lead = f"{verdict.second} is worse than {baseline}"
        wins = "worse"
    elif baseline:
        lead = f"{verdict.leader} is better than {baseline}"
        wins = "better"
    ends = _interval(*verdict.interval) if interval else ""
    by = " ".join(filter(None, [number(verdict.difference), column.unit, ends]))
    if views < 2:
        return f"{name}: {lead} by {by}, on one view"
    effect = (
        f", effect {verdict.effect:.1f}" if interval and math.isfinite(verdict.effect) else ""
    )
    chance = ""
    if verdict.may_be_chance:
        chance = ", which may be chance"
        if column.worth == 0:
            chance += f" (a track needs {FEWEST_VIEWS} views)"
    elif verdict.is_sure and not verdict.is_lead and not baseline:
        chance = f", by more than chance (a lead needs {FEWEST_FOR_LEAD} views)"
    return f"{name}: {lead} by {by}, {wins} in {round(verdict.wins, 1):g} of {views} views{effect}{chance}"


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


@dataclass(frozen=True)
class Deciding:
    """The columns of a comparison that decide."""

    scores: tuple[Column, ...]
    """The main one first."""

    knows_colours: bool
    """False if no score compares with what is true, and nobody voted."""

    main: Column | None
    """The score that sorts the methods; None if no score shows which colours are true."""

    columns: tuple[Column, ...]
    """All of them, in the order of a table: behind the scores, the share of pixels with a colour, and seconds."""


def deciding(comparison: Comparison, every: bool = False) -> Deciding:
    """Return the columns of a comparison that decide; every: all of them, which someone has asked for.

    Scores that know the true colours come first. Without any, people's votes, evidence and scores of the picture alone
    take their place, in this order. If there is room, scores of several views and those without a role follow: those of
    a plugin under test, say.
    """
    scores = comparison.columns
    beside: list[Column] = []
    if not every:
        # the default variant of each metric, or the first that was scored
        once: dict[str, Column] = {}
        for column in scores:
            is_default = (
                column.plugin is not None and column.variant == column.plugin.default[0]
            )
            if column.directed and (column.metric not in once or is_default):
                once[column.metric] = column
        left = [*once.values()]
        known: list[Column] = []
        for role in _TRUE_COLOURS:
            known += [c for c in left if c.role == role and c not in known][:1]
        known = sorted(known[:_MOST], key=lambda column: _TRUE_COLOURS.index(column.role))
        if not known:
            of_people = [column for column in left if column.metric == PREFERENCE]
            evidence = [column for column in left if column.knows == "evidence"]
            of_picture = [column for column in left if column.role == "no-reference"]
            taste = [column for column in of_picture if column.knows == "taste"]
            known = [*of_people, *evidence[:_MOST_BLIND], *taste[:_MOST_BLIND]]
        others = [column for column in left if column not in known and column.role in _OTHERS]
        beside = [c for c in scores if c.is_share_filled or c.metric == RESTORATION]
        chosen = known + others or left
        scores = tuple(column for column in chosen[:_MOST] if column not in beside)
    scores = tuple(sorted(scores, key=lambda column: column.knows == "taste"))
    directed = [column for column in scores if column.directed]
    knows = not directed or any(column.knows == "truth" for column in directed)
    main = next((column for column in directed if knows and column.ranked), None)
    if every and knows:  # the same order, whoever asks
        main = deciding(comparison).main or main
    return Deciding(scores, knows, main, (*scores, *beside))


_OTHERS: frozenset[Role] = frozenset({"", "change-with-distance"})


def best_first(comparison: Comparison, main: Column | None) -> tuple[str, ...]:
    """Return the methods by their mean of a score, those without it behind them, photographs last; else as asked."""
    names = comparison.restorers or comparison.methods
    if main is not None:
        means = {
            name: main.sign * cell.mean
            for name, cell in comparison.of(main).items()
            if not math.isnan(cell.mean)
        }
        names = tuple(sorted(names, key=lambda name: means.get(name, math.inf)))
    return (*names, *(name for name in comparison.photographs if name not in names))


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
    if behind.place == 1 or not math.isfinite(gap):
        return
    yield Verdict(
        column, best, second, gap, (low, high), cells[best].wins, abs(behind.effect), behind.tie
    )


def _differences_from_baseline(comparison: Comparison, column: Column) -> Iterator[Verdict]:
    baseline = comparison.baseline
    for name, cell in comparison.of(column).items():
        change, low, high = cell.change
        if not math.isfinite(change):
            continue
        interval = (low, high) if change > 0 else (-high, -low)
        pair = (name, baseline)
        wins = cell.wins
        if change * column.sign > 0:
            pair = (baseline, name)
            wins = column.n_views - cell.wins
        yield Verdict(
            column,
            *pair,
            abs(change),
            interval,
            wins,
            abs(cell.effect),
            may_be_chance(cell.change),
        )


def answer(comparison: Comparison, chosen: Deciding) -> list[str]:
    """Return a few sentences by the chosen columns: what is wrong with the pictures, and a verdict for each score.

    With a baseline, there is a verdict for each method by the main score alone.
    """
    ranked = [column for column in chosen.scores if column.ranked]
    if comparison.baseline:
        ranked = ranked[:1]
    found = verdicts(replace(comparison, columns=tuple(ranked)))
    if comparison.baseline:  # over one view nobody is better or worse
        found = [
            verdict
            for verdict in found
            if not math.isnan(verdict.interval[0]) or not verdict.difference
        ]
    said = [verdict_text(comparison, verdict, interval=False) for verdict in found]
    said += [
        f"{column.metric}: no method beats the photograph itself"
        for column in ranked
        if _is_beaten(comparison, column)
    ]
    return framed(comparison, chosen, said)


def framed(comparison: Comparison, chosen: Deciding, said: Sequence[str]) -> list[str]:
    """Return sentences behind one about what is wrong with the pictures.

    Where no score shows which colours are true, the first sentence says that, and the last one what to do.
    """
    said = [*faults(comparison), *said]
    return said if chosen.knows_colours else [comparison.blind, *said, comparison.advice]


def _is_beaten(comparison: Comparison, column: Column) -> bool:
    """Whether the photograph has a better mean than each method beside it."""
    worse = {name: column.sign * cell.mean for name, cell in comparison.of(column).items()}
    photographs = [worse.pop(name) for name in comparison.photographs if name in worse]
    return bool(photographs and worse) and min(photographs) < min(worse.values())
