"""The words of a comparison in every format: numbers, headings, cells, legend, notes, verdicts."""

import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.compare.model import FEWEST_VIEWS, Column, Comparison, Note, Verdict, may_be_chance, says_filled
from sucre_bench.machine.text_formats import counted


@dataclass(frozen=True)
class NumberRule:
    """How numbers are rounded.

    decimals: (least size, decimals), largest first; figures: of smaller numbers; scientific_below: from what size on
    these are written as 1.2e-05.
    """

    decimals: tuple[tuple[float, int], ...]
    figures: int
    scientific_below: float


NUMBERS = NumberRule(((100, 0), (10, 1), (1, 2), (0.1, 3)), 2, 1e-4)


def number(value: float) -> str:
    """Return three figures, two below 0.1 (see `NUMBERS`); "-" for NaN."""
    if not math.isfinite(value):
        return "-" if math.isnan(value) else "inf" if value > 0 else "-inf"
    size = abs(value)
    for least, decimals in NUMBERS.decimals:
        if size >= least:
            return f"{value:.{decimals}f}"
    return f"{value:#.{NUMBERS.figures}g}" if size else "0"


def signed(value: float) -> str:
    """A number that says that it is a difference: "+0.31"."""
    return f"+{number(value)}" if value > 0 else number(value)


def standard_deviation(values: Array) -> Array:
    """Return the sample standard deviation over the first axis, with n - 1: the images are a sample of all images.

    values: (N, ...). NaN for fewer than two values, and where one is infinite. The SUCRe paper does not say which
    definition its tables have.
    """
    if len(values) < 2:
        return np.full(values.shape[1:], np.nan)
    with np.errstate(invalid="ignore"):  # infinity minus infinity
        return np.asarray(values.std(axis=0, ddof=1))


_ROUGH = "intervals are rough"


def rough_below() -> str:
    """Return below how many views intervals are rough, and why; it follows a sentence about intervals."""
    return f"over fewer than {FEWEST_VIEWS} views they are rough: so few scores do not show how scores are distributed"


def rough(columns: Sequence[Column]) -> str:
    """Return what says which scores are over too few views for more than rough intervals; "" where none is."""
    counts = _counts(columns)
    few = [(names, alike) for names, alike in counts if alike[0].has_few_views]
    if len(counts) == 1 and few:
        return f"{_views(few[0][1][0])}: {_interval_of_few(few[0][1][0])}"
    return "; ".join(f"{names}: over {_views(alike[0])}, {_interval_of_few(alike[0])}" for names, alike in few)


def over_views(columns: Sequence[Column]) -> list[str]:
    """Return over how many views the scores are: most views first, then the scores that have fewer, by name."""
    (_, first), *others = _counts(columns) or [("", list(columns[:1]))]
    if not first:
        return []
    if first[0].has_few_views and not others:
        hint = ", --intervals shows them" if first[0].n_views > 1 else ""
        return [f"{rough(columns)}{hint}"]
    fewer = [
        f"{names}: over {_views(alike[0])}" + (f", {_interval_of_few(alike[0])}" if alike[0].has_few_views else "")
        for names, alike in others
    ]
    return [f"means over {_views(first[0])}", *fewer]


def over_datasets(mains: Sequence[Column]) -> list[str]:
    """Return over how many views the main score of several datasets is."""
    views = [column.n_views for column in mains]
    few = sum(column.has_few_views for column in mains)
    if min(views) == max(views):
        return over_views(mains[:1])
    rough_in = f"in {few} datasets over fewer than {FEWEST_VIEWS}, where {_ROUGH}"
    return [f"means over {min(views)} to {max(views)} views", *([rough_in] if few else [])]


def over_units(comparison: Comparison) -> Iterator[str]:
    """Yield over how many views: of most metrics, then of those that differ."""
    counts = Counter(_count(column) for column in comparison.columns if column.n_units)
    for place, (count, _) in enumerate(counts.most_common()):
        names = [column.metric for column in comparison.columns if _count(column) == count]
        of = "over " if place == 0 else f"{', '.join(dict.fromkeys(names))} over "
        yield of + count


def _counts(columns: Sequence[Column]) -> list[tuple[str, list[Column]]]:
    """The scores with the same number of views, and their names; the largest number first."""
    measured = [column for column in columns if column.n_units]
    scores = [column for column in measured if column.ranked and not says_filled(column.metric, column.variant)]
    scores = sorted(scores or measured, key=lambda column: -column.n_views)
    groups = [list(alike) for _, alike in itertools.groupby(scores, lambda column: column.n_views)]
    return [(", ".join(dict.fromkeys(column.metric for column in alike)), alike) for alike in groups]


def _views(column: Column) -> str:
    return counted(column.n_views, "view")


def _interval_of_few(column: Column) -> str:
    return "no intervals" if column.n_views < 2 else _ROUGH


def _count(column: Column) -> str:
    scenes = f" of {column.n_scenes} scenes" if column.n_scenes > 1 else ""
    charts = f" ({counted(column.n_units, 'chart')})" if column.of == "chart" else ""
    return _views(column) + scenes + charts


_MOST_NAMES = 4

# What a table says in which no score shows which colours are true.
BLIND = (
    "No chart and no reference: these numbers do not show which colours are true. Look at the pictures, mark a chart"
    " (`sucre-bench charts`), or ask people (`study`)."
)

ARROW = {"higher": "↑", "lower": "↓", "none": ""}


def title(column: Column) -> str:
    """A metric's name with its direction and unit."""
    return " ".join(filter(None, [column.metric, ARROW[column.better], column.unit]))


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
    if not math.isnan(cell.change[0]):
        change, low, high = cell.change
        surely = math.isfinite(low) and not may_be_chance(cell.change)
        is_better = (change > 0) == (column.better == "higher")
        look: Literal["", "better", "worse"] = "better" if is_better else "worse"
        mark = "≈" if change and may_be_chance(cell.change) else ""
        return Shown(
            mark, signed(change), _interval(low, high, signed), holes, look if surely and column.ranked else ""
        )
    value = number(cell.mean) + (f" ± {number(cell.std)}" if spread and not math.isnan(cell.std) else "")
    ranked = column.ranked and not comparison.baseline
    mark = "≈" if ranked and cell.tie else ""
    places: dict[int, Look] = {1: "best", 2: "second"}
    place = places.get(cell.place, "") if ranked and _differ(comparison, column) else ""
    return Shown(mark, value, _interval(cell.low, cell.high), holes, place)


def _differ(comparison: Comparison, column: Column) -> bool:
    """Whether there is a best: among several that are not all equal."""
    return any((cell := comparison.cells.get((name, column))) and cell.place > 1 for name in comparison.methods)


def _interval(low: float, high: float, word: Callable[[float], str] = number) -> str:
    return f"[{word(low)}, {word(high)}]" if math.isfinite(low) else ""


# -- below a table -----------------------------------------------------------------------------------------


def legend(comparison: Comparison, spread: bool = False, colours: bool = False, intervals: bool = True) -> str:
    """Say what the numbers of a table are, over what, what its marks mean, and how intervals are made.

    colours: whether the table tells better and worse by green and red, rather than better by bold; intervals: whether
    it shows them.
    """
    if not comparison.columns:
        return "no scores"
    cells = [shown(comparison, name, column) for name in comparison.methods for column in comparison.columns]
    has_interval = intervals and any(cell.interval for cell in cells)
    looks = {cell.look for cell in cells}
    of = "mean" + (" ± standard deviation" if spread else "") + (" [95 % interval]" if has_interval else "")
    if comparison.baseline:
        of = f"with a sign: the difference from {comparison.baseline}{' [95 % interval]' * has_interval}; else {of}"
    parts = [of, *over_units(comparison)]
    parts += ["bold: best, underlined: second"] * ("best" in looks)
    if looks & {"better", "worse"}:
        parts.append("green: better, red: worse" if colours else "bold: better")
    if any(cell.mark for cell in cells):
        parts.append(f"≈: the difference from {comparison.baseline or 'the best'} may be chance")
    parts += ["○n: lacks n that others have"] * any(cell.holes for cell in cells)
    if comparison.restorers and comparison.photographs:
        parts.append(f"{listed(comparison.photographs)}: the photograph itself, which has no rank")
    return "; ".join([*parts, _how(comparison, has_interval)] if intervals else parts)


def _how(comparison: Comparison, has_interval: bool) -> str:
    """Which intervals these are: of means, and of differences between methods."""
    if not has_interval:
        return "no intervals: one view says nothing of chance"
    few = any(column.n_views > 1 and column.has_few_views for column in comparison.columns if column.ranked)
    units = "scenes" if any(column.n_scenes > 1 for column in comparison.columns) else "views"
    means = f"intervals: bootstrap over {units}"
    end = f"; {rough_below()}" if few else ""
    return f"{means}{_of_differences(comparison)}{end}"


def _of_differences(comparison: Comparison) -> str:
    """Which intervals differences have: those of the methods with scores, from the best or the baseline."""
    scored = {name for name, column in comparison.cells if column.ranked}
    n = len(scored.intersection(comparison.methods if comparison.baseline else comparison.restorers))
    if n < 2:
        return ""
    if n == 2:
        return "; of the difference: Student's"
    of = f"differences from {comparison.baseline}" if comparison.baseline else "leads of the best"
    condition = "if views are an independent sample"  # not neighbours on a track
    return f"; of {of}: step-down max-t over {n} methods: at most 5 % of tables have a false one, {condition}"


def left_out(comparison: Comparison) -> list[str]:
    """Return a sentence for everything that the comparison does not count, with the reason."""
    return [_note_text(note) for note in comparison.notes]


def _note_text(note: Note) -> str:
    name, metrics = listed(note.methods), listed(dict.fromkeys(column.metric for column in note.columns))
    match note.kind:
        case "no result":
            return f"{name} has no result ({note.reasons})"
        case "images lost":
            remain = f"the other {note.left}" if note.n + note.left == note.total else f"the {note.left} that all have"
            on = f"all are compared on {remain}" if note.left else "nothing is left to compare"
            units = f"{note.n} of {note.total} {note.unit}s"
            return f"{name} has no {metrics or 'result'} in {units} ({note.reasons}): {on}"
        case "no score":
            return f"{name} has no score" + (f" ({note.reasons})" if note.reasons else "")
        case "nothing shared":
            (column,) = note.columns
            return f"{column.metric} ({column.variant}): no {note.unit} that {name} all have"
        case "replicates lost":
            lacks = f"{metrics} in repetitions" if metrics else "repetitions"
            images = f"{note.n} image{'s' * (note.n > 1)} ({note.lost} of {note.total})"
            return f"{name} lacks {lacks} of {images}: scores are means of those that all have"
        case "common pixels":
            in_some = f", in {note.n} of {note.total} images" if note.n < note.total else ""
            return f"{metrics} on the pixels that all methods fill: {number(100 * note.share)} % of the image{in_some}"
        case "holes":
            return f"share of the picture without colour: {_shares(note)}"
        case "negative colours":
            return f"share of colours below zero, which no real scene has: {_shares(note)}"
        case "own pixels":
            in_some = f" in {note.n} of {note.total} images" if note.n < note.total else ""
            why = f" ({note.reasons})" if note.reasons else ""
            return f"{metrics}{in_some} on each method's own pixels, which differ{why}"
        case "no shared pixels":
            return f"no score in {note.n} of {note.total} images, because they have no pixel that all methods fill"
        case "older data":
            return f"left out, because they ran on other data: {', '.join(note.methods)}"
        case "no baseline":
            return f"{name} was not run here: there is nothing to compare with"
        case "no option":
            return f"{name} is left out: it has no option {note.option}"


def _shares(note: Note) -> str:
    return listed(f"{name} {100 * share:.0f} %" for name, share in zip(note.methods, note.shares, strict=True))


def with_unit(value: float, column: Column, *more: str) -> str:
    """Return a number in the column's unit, and more after it."""
    return " ".join(filter(None, [number(value), column.unit, *more]))


def listed(names: Iterable[str]) -> str:
    """Return names as text, at most four and how many more there are."""
    names = list(names)
    more = len(names) - _MOST_NAMES
    return ", ".join(names) if more <= 1 else f"{', '.join(names[:_MOST_NAMES])} and {more} more"


# -- verdicts ----------------------------------------------------------------------------------------------


def verdict_text(comparison: Comparison, verdict: Verdict) -> str:
    """Return a verdict as a sentence: who is ahead, by how much, how steadily, and whether it may be chance.

    With a baseline, the sentence is about the other method.
    """
    column, baseline = verdict.column, comparison.baseline
    several = [c.metric for c in comparison.columns].count(column.metric) > 1
    name = f"{column.metric} ({column.variant})" if several else column.metric
    if baseline and not verdict.difference:
        return f"{name}: {verdict.leader} equals {verdict.second}"
    by = with_unit(verdict.difference, column, _interval(*verdict.interval))
    if baseline == verdict.leader:
        lead, wins = f"{verdict.second} is worse than {baseline}", "worse in"
    elif baseline:
        lead, wins = f"{verdict.leader} is better than {baseline}", "better in"
    else:
        lead, wins = ahead(verdict), "best in"
    return f"{name}: {lead} by {by}{_evidence(verdict, wins)}"


def ahead(verdict: Verdict) -> str:
    """Return who leads whom, or is only ahead: the difference may be chance."""
    return f"{verdict.leader} {'leads' if verdict.is_lead else 'is ahead of'} {verdict.second}"


def _evidence(verdict: Verdict, wins: str) -> str:
    views = verdict.column.n_views
    if views < 2:
        return ", on one view"
    size = f", effect {verdict.effect:.1f}" if math.isfinite(verdict.effect) else ""
    chance = ", which may be chance" if verdict.may_be_chance else ""
    return f", {wins} {round(verdict.wins, 1):g} of {views} views{size}{chance}"
