"""The words of a comparison in every format: numbers, headings, cells, legend, notes, verdicts."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from sucre_bench.compare.model import Column, Comparison, Note, Verdict, may_be_chance, says_filled
from sucre_bench.machine.text_formats import counted

# How numbers are rounded: decimals from what size on, the largest first; figures of smaller ones, and from what size on
# these are written as 1.2e-05.
_DECIMALS, _FIGURES = ((100, 0), (10, 1), (1, 2), (0.1, 3)), 2
NUMBERS = {"decimals": _DECIMALS, "figures": _FIGURES, "scientific_below": 1e-4}

ARROW = {"higher": "↑", "lower": "↓", "none": ""}

_MOST_NAMES = 4
_ALIKE = 0.75  # of the views: if they are worth fewer independent ones, a table says so


def number(value: float) -> str:
    """Return three figures, two below 0.1 (see `NUMBERS`); "-" for NaN."""
    if not math.isfinite(value):
        return "-" if math.isnan(value) else "inf" if value > 0 else "-inf"
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


def listed(names: Iterable[str]) -> str:
    """Return names as text, at most four and how many more there are."""
    names = list(names)
    more = len(names) - _MOST_NAMES
    return ", ".join(names) if more <= 1 else f"{', '.join(names[:_MOST_NAMES])} and {more} more"


# -- cells -------------------------------------------------------------------------------------------------


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
    look: Literal["", "best", "second", "better", "worse"]

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
        is_sure = column.ranked and math.isfinite(low) and not is_chance
        is_better = (change > 0) == (column.better == "higher")
        mark = "≈" if change and is_chance and column.knows != "taste" else ""
        look: Literal["", "better", "worse"] = "" if not is_sure else "better" if is_better else "worse"
        return Shown(mark, signed(change), _interval(low, high, signed), holes, look)
    value = number(cell.mean) + (f" ± {number(cell.std)}" if spread and not math.isnan(cell.std) else "")
    if comparison.baseline or not column.ranked:
        return Shown("", value, _interval(cell.low, cell.high), holes, "")
    differ = any(c.place > 1 for c in comparison.of(column).values())  # else there is no best
    place: Literal["", "best", "second"] = "best" if cell.place == 1 else "second" if cell.place == 2 else ""
    return Shown("≈" if cell.tie else "", value, _interval(cell.low, cell.high), holes, place if differ else "")


def _interval(low: float, high: float, word: Callable[[float], str] = number) -> str:
    return f"[{word(low)}, {word(high)}]" if math.isfinite(low) else ""


# -- below a table -----------------------------------------------------------------------------------------


def over_views(columns: Sequence[Column]) -> list[str]:
    """Return over how many views the scores are: most views first, then the scores that have fewer, by name."""
    measured = [column for column in columns if column.n_units]
    scores = [column for column in measured if column.ranked and not says_filled(column.metric, column.variant)]
    alike: dict[str, list[str]] = {}
    for column in sorted(scores or measured, key=lambda column: -column.n_views):
        scenes = f" of {column.n_scenes} scenes" if column.n_scenes > 1 else ""
        charts = f" ({counted(column.n_units, 'chart')})" if column.n_units > column.n_views else ""
        alike.setdefault(f"over {counted(column.n_views, 'view')}{scenes}{charts}{roughness(column)}", []).append(
            column.metric
        )
    return [f"{listed(dict.fromkeys(names))}: {over}" if n else over for n, (over, names) in enumerate(alike.items())]


def roughness(column: Column) -> str:
    """Return what to say of the intervals of a score: that there are few views, or that neighbours are alike."""
    if column.has_few_views:  # they do not show the distribution
        return ", no intervals" if column.n_views < 2 else ", intervals are rough"
    if column.worth > _ALIKE * column.n_views or not column.ranked:
        return ""
    return f" (neighbours are alike: worth about {column.worth:.0f} independent; every=4 gives more)"


def signs(comparison: Comparison, cells: Sequence[Shown], colours: bool) -> list[str]:
    """Return what the marks of cells mean. colours: whether better and worse are green and red, not bold."""
    looks = {cell.look for cell in cells}
    parts = ["bold: best, underlined: second" if "second" in looks else "bold: best"] * ("best" in looks)
    parts += ["green: better, red: worse" if colours else "bold: better"] * bool(looks & {"better", "worse"})
    parts += [f"≈: the difference from {comparison.baseline or 'the best'} may be chance"] * any(c.mark for c in cells)
    parts += ["○n: lacks n that others have"] * any(cell.holes for cell in cells)
    photographs = comparison.photographs if comparison.restorers else ()
    return parts + [f"{name}: the photograph itself, which has no rank" for name in photographs]


def legend(comparison: Comparison, spread: bool = False, colours: bool = False, intervals: bool = True) -> str:
    """Say what the numbers of a table are, over what, what its marks mean, and how intervals are made.

    colours: whether the table tells better and worse by green and red, rather than better by bold; intervals: whether
    it shows them.
    """
    if not comparison.columns:
        return "no scores"
    cells = [shown(comparison, name, column) for name in comparison.methods for column in comparison.columns]
    has_interval = intervals and any(cell.interval for cell in cells)
    of = "mean" + " ± standard deviation" * spread + " [95 % interval]" * has_interval
    if comparison.baseline:
        of = f"with a sign: the difference from {comparison.baseline}{' [95 % interval]' * has_interval}; else {of}"
    parts = [of, *over_views(comparison.columns), *signs(comparison, cells, colours)]
    if has_interval:
        units = "scenes" if any(column.n_scenes > 1 for column in comparison.columns) else "views"
        parts += [f"intervals: bootstrap over {units}", *_of_differences(comparison)]
    return "; ".join(parts)


def _of_differences(comparison: Comparison) -> list[str]:
    """Which intervals differences have: those of the methods with scores, from the best or the baseline."""
    scored = {name for name, column in comparison.cells if column.ranked}
    n = len(scored.intersection(comparison.methods if comparison.baseline else comparison.restorers))
    if n < 3:
        return ["of the difference: Student's"] if n == 2 else []
    of = f"differences from {comparison.baseline}" if comparison.baseline else "leads of the best"
    condition = "if no method fails rarely"
    return [f"of {of}: step-down max-t over {n} methods: about 5 % of tables have a false one, {condition}"]


# What the kinds of notes say.
NOTES = {
    "no result": "{names} has no result ({note.reasons})",
    "images lost": "{names} has no {what} in {note.n} of {note.total} {note.unit}s ({note.reasons}): {left}",
    "no score": "{names} has no score{why}",
    "nothing shared": "{metrics}: no {note.unit} that {names} all have",
    "replicates lost": "{names} lacks {note.lost} of {note.total} repetitions, of {images}{of_metrics}: "
    "scores are means of those that all have",
    "common pixels": "{metrics} on the pixels that all methods fill: {share} % of the image{in_some}",
    "own pixels": "{metrics}{in_some} on each method's own pixels, which differ{why}",
    "no shared pixels": "no score in {note.n} of {note.total} images, because they have no pixel that all methods fill",
    "differs": "{names} differs from its publication: {note.reasons}",
    "opinions": "what people thought of pictures by these methods in published studies, {note.reasons}",
    "trained on": "{names} was trained on: {note.reasons}",
    "older data": "left out, because they ran on other data: {names}",
    "no baseline": "{names} was not run here: there is nothing to compare with",
    "no option": "{names} is left out: it has no option {note.option}",
}


def left_out(comparison: Comparison) -> list[str]:
    """Return a sentence for everything that the comparison does not count, with the reason."""
    return [_note_text(note) for note in comparison.notes if note.kind != "faults"]


def faults(comparison: Comparison) -> list[str]:
    """Return a sentence that says what is wrong with the pictures of each method; none where nothing is."""
    said = "; ".join(f"{note.methods[0]}: {note.reasons}" for note in comparison.notes if note.kind == "faults")
    return [f"What is wrong with the pictures: {said}"] if said else []


def _note_text(note: Note) -> str:
    metrics = listed(dict.fromkeys(column.metric for column in note.columns))
    rest = f"the other {note.left}" if note.n + note.left == note.total else f"the {note.left} that all have"
    return NOTES[note.kind].format(
        note=note,
        names=listed(note.methods),
        metrics=metrics,
        what=metrics or "result",
        images=counted(note.n, "image"),
        of_metrics=f", of {metrics}" if metrics else "",
        left=f"all are compared on {rest}" if note.left else "nothing is left to compare",
        why=f" ({note.reasons})" if note.reasons else "",
        in_some=f" in {note.n} of {note.total} images" if note.n < note.total else "",
        share=number(100 * note.share),
    )


# -- verdicts ----------------------------------------------------------------------------------------------


def verdict_text(comparison: Comparison, verdict: Verdict, interval: bool = True) -> str:
    """Return a verdict as a sentence: who is ahead, by how much, how steadily, and whether it may be chance.

    With a baseline, the sentence is about the other method. interval: whether it has the interval and the effect.
    """
    column, baseline, views = verdict.column, comparison.baseline, verdict.column.n_views
    several = [c.metric for c in comparison.columns].count(column.metric) > 1
    name = by_score(column, f"{column.metric} ({column.variant})" if several else column.metric)
    if baseline and not verdict.difference:
        return f"{name}: {verdict.leader} equals {verdict.second}"
    lead, wins = f"{verdict.leader} {'leads' if verdict.is_lead else 'is ahead of'} {verdict.second}", "best"
    if baseline == verdict.leader:
        lead, wins = f"{verdict.second} is worse than {baseline}", "worse"
    elif baseline:
        lead, wins = f"{verdict.leader} is better than {baseline}", "better"
    ends = _interval(*verdict.interval) if interval else ""
    by = f"{with_unit(verdict.difference, column)} {ends}".rstrip()
    if views < 2:
        return f"{name}: {lead} by {by}, on one view"
    effect = f", effect {verdict.effect:.1f}" if interval and math.isfinite(verdict.effect) else ""
    chance = ", which may be chance" if verdict.may_be_chance else ""
    chance = f", but without {verdict.undone_by} it may be chance" if verdict.undone_by else chance
    return f"{name}: {lead} by {by}, {wins} in {round(verdict.wins, 1):g} of {views} views{effect}{chance}"


def by_score(column: Column, name: str = "") -> str:
    """Return what stands before a verdict: the score, and of evidence how well it agrees with truth."""
    name = name or column.metric
    if column.knows != "evidence":
        return name
    return f"By {name}, which agrees with true colours in {10 * column.agreement:.0f} of 10 pairs of methods"


def with_unit(value: float, column: Column) -> str:
    """Return a number in the column's unit."""
    return f"{number(value)} {column.unit}".rstrip()
