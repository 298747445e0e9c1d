"""A comparison for the terminal: one block with the columns that decide, or a table of every column."""

from __future__ import annotations

import itertools
import math
import re
import textwrap
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from statistics import fmean
from typing import TYPE_CHECKING, Any

from sucre_bench.compare.answer import Deciding, answer, deciding, verdicts
from sucre_bench.compare.model import Column, Comparison
from sucre_bench.compare.words import (
    ARROW,
    BLIND,
    Shown,
    left_out,
    legend,
    over_datasets,
    over_views,
    rough,
    shown,
    signed,
    title,
    verdict_text,
)

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.text import Text


_STYLE = {"best": "bold green", "second": "underline", "better": "green", "worse": "red"}
_SHORTEST_NAMES = 20  # characters that the names of methods have at least


def aligned(methods: Sequence[str], laid_out: Sequence[LaidOut], width: int, dim: Collection[str] = ()) -> list[Text]:
    """Tables of as many columns as fit beside each other, a name too long for its column on a line of its own.

    dim: methods whose names are set so.
    """
    from rich.text import Text

    widths = [column.width for column in laid_out]
    longest, left = max(len(name) for name in ("method", *methods)), width - sum(2 + wide for wide in widths)
    first = min(longest, max(left, _SHORTEST_NAMES))
    made = []
    for places in blocks(widths, width - first):
        block = laid_out[places]
        lines = [_line("method", first, [Text(f"{column.head[0]:>{column.width}}") for column in block])]
        lines[0].stylize("bold")
        if any(column.head[1] for column in block):
            lines.append(_line("", first, [Text(f"{column.head[1]:>{column.width}}", style="dim") for column in block]))
        for n, name in enumerate(methods):
            lines.append(_line(name, first, [column.painted(n) for column in block], "dim" if name in dim else ""))
        made.append(Text("\n").join(lines))
    return made


def blocks(widths: Sequence[int], room: int) -> list[slice]:
    """Return which columns stand beside each other: as few groups as fit into `room` characters, of similar width.

    There are two characters between columns. A column wider than `room` stands alone.
    """
    fewest = _greedy(widths, room)
    narrower = (_greedy(widths, less) for less in range(max(widths, default=0), room))
    return next((even for even in narrower if len(even) == len(fewest)), fewest)


def _greedy(widths: Sequence[int], room: int) -> list[slice]:
    made, start, left = [], 0, room
    for n, width in enumerate(widths):
        if n > start and width + 2 > left:
            made.append(slice(start, n))
            start, left = n, room
        left -= width + 2
    return [*made, slice(start, len(widths))] if widths else made


def _line(name: str, width: int, cells: Sequence[Text], style: str = "") -> Text:
    from rich.text import Text

    is_long = len(name) > width
    line = Text(name, style=style) + Text(f"\n{'':{width}}" if is_long else " " * (width - len(name)))
    for cell in cells:
        line.append("  ").append_text(cell)
    line.rstrip()
    return line


@dataclass(frozen=True)
class LaidOut:
    """A column's heading in two lines, its cells, and how wide each of their parts is."""

    head: tuple[str, str]
    cells: tuple[Shown, ...]

    @classmethod
    def of(
        cls, comparison: Comparison, column: Column, spread: bool, intervals: bool, head: tuple[str, str]
    ) -> LaidOut:
        cells = (shown(comparison, name, column, spread) for name in comparison.methods)
        return cls(head, tuple(cell if intervals else replace(cell, interval="") for cell in cells))

    @property
    def value(self) -> int:
        return max(len(_marked(cell)) for cell in self.cells)

    @property
    def interval(self) -> int:
        return max(len(cell.interval) for cell in self.cells)

    @property
    def holes(self) -> int:
        return max(len(cell.holes) for cell in self.cells)

    @property
    def width(self) -> int:
        return max(*map(len, self.head), self._of_cells)

    @property
    def _of_cells(self) -> int:
        return self.value + sum(1 + part for part in (self.interval, self.holes) if part)

    def painted(self, n: int) -> Text:
        """The cell of the n-th method, flush right as a whole: its parts stand below those of the cells above."""
        from rich.text import Text

        cell = self.cells[n]
        value = _marked(cell)
        text = Text(" " * (self.width - self._of_cells + self.value - len(value)))
        text.append(value, style=_STYLE.get(cell.look, "dim" if cell.mark else ""))
        for part, width in ((cell.interval, self.interval), (cell.holes, self.holes)):
            if width:
                text.append(f" {part:<{width}}", style="dim")
        return text


def _marked(cell: Shown) -> str:
    return f"{cell.mark} {cell.value}".lstrip()


_MOST_NOTES = 5
_MOST_BLOCKS = 3  # datasets with a block of their own


def as_table(comparison: Comparison, width: int, spread: bool = False, intervals: bool = True) -> RenderableType:
    """Return a rich renderable: all columns, in blocks of as many as `width` characters have room for.

    The methods are in the order of `as_blocks`, and lines are broken between words. spread: with standard deviations;
    intervals: with 95 % intervals, and a sentence for each lead.
    """
    from rich.console import Group
    from rich.text import Text

    chosen = deciding(comparison)
    comparison = replace(comparison, methods=_best_first(comparison, chosen))
    laid_out = [
        LaidOut.of(comparison, column, spread, intervals, (title(column), column.variant))
        for column in comparison.columns
    ]
    parts: list[Any] = [_wrapped(_head(comparison, chosen), width, "bold")]
    parts += [part for lines in aligned(comparison.methods, laid_out, width) for part in (lines, Text(""))]
    said = [
        "" if intervals else rough(comparison.columns),
        legend(comparison, spread, colours=True, intervals=intervals),
    ]
    parts += [_wrapped(line, width, "dim") for line in (*said, *left_out(comparison)) if line]
    leads = [verdict_text(comparison, verdict) for verdict in verdicts(comparison)] if intervals else []
    blind = [] if chosen.knows_colours else [BLIND]
    return Group(*parts, *(_wrapped(line, width) for line in (*leads, *blind)))


def _head(comparison: Comparison, chosen: Deciding) -> str:
    return f"{comparison.title}{'' if chosen.main is None else f', best {chosen.main.metric} first'}"


def _block(comparison: Comparison, width: int, every: bool) -> RenderableType:
    """Return a rich renderable: the columns that decide, the best method first, and the answer in two sentences.

    The photograph stands below the methods. Lines are broken between words, to `width` characters.
    """
    from rich.console import Group

    chosen = deciding(comparison, every)
    methods = _best_first(comparison, chosen)
    block = replace(comparison, methods=methods, columns=chosen.columns)
    laid_out = [_decider(block, column, chosen) for column in block.columns]
    parts: list[Any] = [
        _wrapped(_head(block, chosen), width, "bold"),
        *aligned(methods, laid_out, width, comparison.photographs),
    ]
    said = [_signs(block, laid_out, over_views(block.columns)), *_notes(block)]
    parts += [_wrapped(line, width, "dim") for line in said if line]
    return Group(*parts, *(_wrapped(line, width) for line in answer(block, chosen)))


def as_blocks(comparisons: Sequence[Comparison], width: int, every: bool = False) -> list[RenderableType]:
    """Return a renderable for each comparison; one for all those of many datasets with the same main score.

    every: with all columns, each comparison by itself.
    """
    by_first: dict[tuple[str, str], list[Comparison]] = {}
    for comparison in comparisons:
        first = deciding(comparison).first
        by_first.setdefault((first.metric, first.variant) if first else ("", ""), []).append(comparison)
    made: list[RenderableType] = []
    for (metric, _), group in by_first.items():
        is_overview = metric and len(group) > _MOST_BLOCKS and not every
        made += [_overview(group, width)] if is_overview else [_block(one, width, every) for one in group]
    return made


def _overview(comparisons: Sequence[Comparison], width: int) -> RenderableType:
    """The main score of every dataset: a line a method, a column a dataset."""
    from rich.console import Group

    mains = [column for one in comparisons if (column := deciding(one).first)]
    ranked = [_best_first(one, deciding(one)) for one in comparisons]
    places = {
        name: [ranking.index(name) for ranking in ranked if name in ranking] for ranking in ranked for name in ranking
    }
    apart = {name for one in comparisons if one.restorers for name in one.photographs}
    blind = [one for one in comparisons if not deciding(one).knows_colours]
    methods = [*places] if blind else sorted(places, key=lambda name: (name in apart, fmean(places[name])))
    titles = [one.title for one in comparisons]
    prefix = _shared_start(titles)
    laid_out = []
    for one, column in zip(comparisons, mains, strict=True):
        cells = [shown(one, name, column) for name in methods]
        heading = (one.title.removeprefix(prefix), "")
        laid_out.append(LaidOut(heading, tuple(replace(cell, interval="") for cell in cells)))
    head = f"{title(mains[0])} of {len(titles)} datasets{': ' + prefix if prefix else ''}"
    signs = _signs(comparisons[0], laid_out, over_datasets(mains))
    best = Counter(
        ranking[0]
        for one, ranking, column in zip(comparisons, ranked, mains, strict=True)
        if column.ranked and ranking[0] not in apart and (ranking[0], column) in one.cells
    )
    counts = ", ".join(f"{name} in {n}" for name, n in best.most_common())
    line = f"best {mains[0].metric}: {counts} of {len(titles)}" if best else ""
    parts = [_wrapped(head, width, "bold"), *aligned(methods, laid_out, width, apart)]
    said = [_wrapped(text, width, "dim") for text in (signs, *_pixels(comparisons, mains))]
    return Group(*parts, *said, *(_wrapped(text, width) for text in (line, BLIND * bool(blind)) if text))


def _pixels(comparisons: Sequence[Comparison], mains: Sequence[Column]) -> Iterator[str]:
    """On which pixels the main scores of several datasets are, if methods fill different ones."""
    noted = [{note.kind for note in one.notes if {*note.columns} & {*mains}} for one in comparisons]
    for kind, where in (("common pixels", "on the pixels that all methods fill"), ("own pixels", "on own pixels")):
        if n := sum(kind in kinds for kinds in noted):
            yield f"in {n} of {len(comparisons)} datasets methods fill different pixels; scores are {where}"


def _shared_start(titles: Sequence[str]) -> str:
    """What all titles begin with, up to the last sign that ends a word of a label."""
    pairs = itertools.takewhile(lambda letters: len({*letters}) == 1, zip(*titles, strict=False))
    return re.sub(r"[^,=·/ ]*$", "", "".join(letters[0] for letters in pairs))


def _wrapped(line: str, width: int, style: str = "") -> Text:
    from rich.text import Text

    text = textwrap.fill(line, width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
    return Text(text, style=style)


def _best_first(comparison: Comparison, chosen: Deciding) -> tuple[str, ...]:
    """The methods by their mean of the main score, those without it behind them, the photograph last; else as asked."""
    if chosen.main is None:
        return comparison.methods
    names = comparison.restorers or comparison.methods
    cells = {name: comparison.cells.get((name, chosen.main)) for name in names}
    sign = -1 if chosen.main.better == "higher" else 1
    names = tuple(
        sorted(names, key=lambda name: (cells[name] is None, sign * cell.mean if (cell := cells[name]) else 0))
    )
    return (*names, *(name for name in comparison.photographs if name not in names))


def _decider(comparison: Comparison, column: Column, chosen: Deciding) -> LaidOut:
    if column == chosen.filled:
        head = ("filled", "%")
    elif column == chosen.seconds:
        head = ("s/view", "")
    else:
        head = (f"{column.metric} {ARROW[column.better]}".rstrip(), column.unit)
    laid_out = LaidOut.of(comparison, column, spread=False, intervals=False, head=head)
    cells = laid_out.cells
    if column == chosen.filled:
        cells = tuple(
            replace(cell, value=_percent(comparison, name, column))
            for name, cell in zip(comparison.methods, cells, strict=True)
        )
    cells = tuple(replace(cell, look="") if cell.look == "second" else cell for cell in cells)
    return replace(laid_out, cells=cells)


def _percent(comparison: Comparison, name: str, column: Column) -> str:
    """A share in per cent, never rounded up to all; a difference of shares with its sign, never rounded to none."""
    cell = comparison.cells.get((name, column))
    if cell is None:
        return "-"
    if math.isnan(cell.change[0]):
        return f"{100 * cell.mean:.0f}" if not 0.995 <= cell.mean < 1 else "99"
    change = 100 * cell.change[0]
    return f"{change:+.0f}" if abs(change) >= 1 else signed(change)


def _signs(comparison: Comparison, laid_out: Sequence[LaidOut], over: Sequence[str]) -> str:
    """What the signs of a block mean. over: how many views."""
    cells = [cell for column in laid_out for cell in column.cells]
    looks = {cell.look for cell in cells}
    baseline = comparison.baseline
    parts = [f"differences from {baseline}"] * bool(baseline) + [*over]
    parts += ["bold: best"] * ("best" in looks)
    parts += ["green: better, red: worse"] * bool(looks & {"better", "worse"})
    parts += [f"≈: the difference from {baseline or 'the best'} may be chance"] * any(c.mark for c in cells)
    parts += ["○n: lacks n that others have"] * any(cell.holes for cell in cells)
    photographs = comparison.photographs if comparison.restorers else ()
    parts += [f"{name}: the photograph itself" for name in photographs]
    return "; ".join(parts)


def _notes(comparison: Comparison) -> list[str]:
    """What is not counted, of the columns of the block."""
    columns = {*comparison.columns}
    notes = [
        replace(note, columns=tuple(column for column in note.columns if column in columns))
        for note in comparison.notes
        if not note.columns or columns & {*note.columns}
    ]
    lines = left_out(replace(comparison, notes=tuple(notes)))
    more = len(lines) - _MOST_NOTES
    return lines if more <= 0 else [*lines[:_MOST_NOTES], f"and {more} more of this kind, with --all-metrics"]
