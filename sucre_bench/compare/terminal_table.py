"""A comparison for the terminal: one block with the columns that decide, or a table of every column."""

from __future__ import annotations

import itertools
import re
import textwrap
from collections import Counter, defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from statistics import fmean
from typing import TYPE_CHECKING

from sucre_bench.compare import words
from sucre_bench.compare.model import FEWEST_VIEWS, Column, Comparison
from sucre_bench.compare.words import Deciding, answer, best_first, deciding, verdicts

if TYPE_CHECKING:
    from rich.text import Text

_STYLE = {"best": "bold green", "second": "underline", "better": "green", "worse": "red"}
_SHORTEST_NAMES = 20  # characters that the names of methods have at least
_MOST_NOTES = 5
_MOST_BLOCKS = 3  # comparisons with a block of their own


@dataclass(frozen=True)
class _Laid:
    """A column: its heading in two lines, its cells, and whether all of it is dim, because nobody wins by it."""

    head: tuple[str, str]
    cells: list[words.Shown]
    is_dim: bool = False

    def texts(self) -> list[Text]:
        """Its lines, all of one width: numbers, intervals and holes stand each below those of the cells above."""
        from rich.text import Text

        marked = [f"{cell.mark} {cell.value}".lstrip() for cell in self.cells]
        value, interval, holes = (
            max(map(len, parts)) for parts in (marked, [c.interval for c in self.cells], [c.holes for c in self.cells])
        )
        lines = [Text(self.head[0], "dim" if self.is_dim else "bold"), Text(self.head[1], "dim")]
        for cell, text in zip(self.cells, marked, strict=True):
            line = Text(" " * (value - len(text))).append(
                text, _STYLE.get(cell.look, "dim" if cell.mark or self.is_dim else "")
            )
            for part, width in ((cell.interval, interval), (cell.holes, holes)):
                line.append(f" {part:<{width}}" if width else "", "dim")
            lines.append(line)
        wide = max(map(len, lines))
        return [Text(" " * (wide - len(line))) + line for line in lines]


def _aligned(methods: Sequence[str], laid_out: Sequence[_Laid], width: int, dim: Collection[str] = ()) -> list[Text]:
    """Tables of as many columns as fit beside each other, a name too long for its column on a line of its own.

    dim: methods whose names are set so.
    """
    from rich.text import Text

    columns = [column.texts() for column in laid_out]
    widths = [len(texts[0]) for texts in columns]
    longest, left = max(len(name) for name in ("method", *methods)), width - sum(2 + wide for wide in widths)
    first = min(longest, max(left, _SHORTEST_NAMES))
    made = []
    for places in blocks(widths, width - first):
        lines = []
        for name, *cells in zip(("method", "", *methods), *columns[places], strict=True):
            style = "bold" if name == "method" else "dim" if name in dim else ""
            line = Text(name, style).append("\n" + " " * first if len(name) > first else " " * (first - len(name)))
            for cell in cells:
                line.append("  ").append_text(cell)
            line.rstrip()
            lines.append(line)
        has_units = any(column.head[1] for column in laid_out[places])
        made.append(Text("\n").join(lines if has_units else [lines[0], *lines[2:]]))
    return made


def blocks(widths: Sequence[int], room: int) -> list[slice]:
    """Return which columns stand beside each other: as few groups as fit into `room` characters, of similar width.

    There are two characters between columns. A column wider than `room` stands alone.
    """

    def greedy(room: int) -> list[slice]:
        ends, left = [0], room
        for n, width in enumerate(widths):
            if n > ends[-1] and width + 2 > left:
                ends.append(n)
                left = room
            left -= width + 2
        return [slice(*pair) for pair in itertools.pairwise([*ends, len(widths)])] if widths else []

    fewest = greedy(room)
    narrower = (greedy(less) for less in range(max(widths, default=0), room))
    return next((even for even in narrower if len(even) == len(fewest)), fewest)


def as_table(comparison: Comparison, width: int, spread: bool = False, intervals: bool = True) -> Text:
    """Return a text for rich: all columns, in blocks of as many as `width` characters have room for.

    The methods are in the order of `as_blocks`, and lines are broken between words. spread: with standard deviations;
    intervals: with 95 % intervals, and a sentence for each lead.
    """
    from rich.text import Text

    chosen = deciding(comparison)
    comparison = replace(comparison, methods=best_first(comparison, chosen.main))
    laid_out = [
        _laid(comparison, column, (words.title(column), column.variant), spread, intervals)
        for column in comparison.columns
    ]
    tables = [part for table in _aligned(comparison.methods, laid_out, width) for part in (table, Text(""))]
    dim = [words.legend(comparison, spread, colours=True, intervals=intervals), *words.left_out(comparison)]
    said = [words.verdict_text(comparison, verdict) for verdict in verdicts(comparison)] if intervals else []
    said = [*words.faults(comparison), *said]
    said = said if chosen.knows_colours else [comparison.blind, *said, comparison.advice]
    return _joined(_head(comparison, chosen), tables, dim, said, width)


def as_blocks(comparisons: Sequence[Comparison], width: int, every: bool = False) -> list[Text]:
    """Return a text for rich for each comparison; one for all those of many datasets with the same main score.

    every: with all columns, each comparison by itself.
    """
    by_first: dict[tuple[str, str], list[Comparison]] = {}
    for comparison in comparisons:
        first = deciding(comparison).first
        by_first.setdefault((first.metric, first.variant) if first else ("", ""), []).append(comparison)
    made: list[Text] = []
    for (metric, _), group in by_first.items():
        is_overview = metric and len(group) > _MOST_BLOCKS and not every
        made += [_overview(group, width)] if is_overview else [_block(one, width, every) for one in group]
    return made


def _block(comparison: Comparison, width: int, every: bool) -> Text:
    """The columns that decide, the best method first, and the answer in two sentences.

    The photograph stands below the methods. Lines are broken between words, to `width` characters.
    """
    chosen = deciding(comparison, every)
    wanted = {*chosen.columns}
    notes = [
        replace(note, columns=tuple(column for column in note.columns if column in wanted))
        for note in comparison.notes
        if not note.columns or wanted & {*note.columns}
    ]
    methods = best_first(comparison, chosen.main)
    block = replace(comparison, methods=methods, columns=chosen.columns, notes=tuple(notes))
    laid_out = []
    for column in block.columns:
        head = (f"{column.metric} {words.ARROW[column.better]}".rstrip(), column.unit)
        if column == chosen.filled:
            head = ("filled", "%")
        elif column == chosen.seconds:
            head = ("s/view", "")
        laid = _laid(block, column, head, intervals=False)
        cells = [replace(cell, look="" if cell.look == "second" else cell.look) for cell in laid.cells]
        if column == chosen.filled:
            cells = [
                replace(cell, value=_percent(block, name, column)) for name, cell in zip(methods, cells, strict=True)
            ]
        laid_out.append(replace(laid, cells=cells))
    lines = words.left_out(block)
    more = len(lines) - _MOST_NOTES
    lines = lines[:_MOST_NOTES]
    lines += [f"and {more} more of this kind, with --all-metrics"] * (more > 0)
    over = [f"means {over}" if n == 0 else over for n, over in enumerate(words.over_views(block.columns))]
    dim = [_signs(block, laid_out, over), *lines]
    tables = _aligned(methods, laid_out, width, comparison.photographs)
    return _joined(_head(block, chosen), tables, dim, answer(block, chosen), width)


def _overview(comparisons: Sequence[Comparison], width: int) -> Text:
    """The main score of every dataset: a line a method, a column a dataset."""
    chosen = [deciding(one) for one in comparisons]
    mains = [each.first for each in chosen if each.first]
    ranked = [best_first(one, each.main) for one, each in zip(comparisons, chosen, strict=True)]
    places = defaultdict[str, list[int]](list)
    for place, name in (each for ranking in ranked for each in enumerate(ranking)):
        places[name].append(place)
    apart = {name for one in comparisons if one.restorers for name in one.photographs}
    blind = [one for one, each in zip(comparisons, chosen, strict=True) if not each.knows_colours]
    methods = [*places] if blind else sorted(places, key=lambda name: (name in apart, fmean(places[name])))
    titles = [one.title for one in comparisons]
    letters = itertools.takewhile(lambda signs: len({*signs}) == 1, zip(*titles, strict=False))
    prefix = re.sub(r"[^,=·/ ]*$", "", "".join(same[0] for same in letters))  # up to the end of a word of a label
    laid_out = [
        _laid(replace(one, methods=tuple(methods)), column, (one.title.removeprefix(prefix), ""), intervals=False)
        for one, column in zip(comparisons, mains, strict=True)
    ]
    n, views = len(titles), [column.n_views for column in mains]
    over = [f"means {words.over_views(mains[:1])[0]}" if mains[0].n_units else ""]
    if min(views) < max(views):
        few = sum(column.has_few_views for column in mains)
        over = [f"means over {min(views)} to {max(views)} views"]
        over += [f"in {few} tables over fewer than {FEWEST_VIEWS}, where intervals are rough"] * bool(few)
    dim = [_signs(comparisons[0], laid_out, over)]
    noted = [{note.kind for note in one.notes if {*note.columns} & {*mains}} for one in comparisons]
    for kind, where in (("common pixels", "on the pixels that all methods fill"), ("own pixels", "on own pixels")):
        if some := sum(kind in kinds for kinds in noted):
            dim.append(f"in {some} of {n} tables methods fill different pixels; scores are {where}")
    ours = (replace(one, notes=tuple(note for note in one.notes if note.kind == "by us")) for one in comparisons)
    dim += dict.fromkeys(text for one in ours for text in words.left_out(one))
    best = Counter(
        ranking[0]
        for one, ranking, column in zip(comparisons, ranked, mains, strict=True)
        if column.ranked and ranking[0] not in apart and (ranking[0], column) in one.cells
    )
    counts = ", ".join(f"{name} in {times}" for name, times in best.most_common())
    said = [f"best {mains[0].metric}: {counts} of {n}"] if best else []
    said += [text for one in blind[:1] for text in (one.blind, one.advice)]
    head = f"{words.title(mains[0])} of {n} tables{': ' + prefix if prefix else ''}"
    return _joined(head, _aligned(methods, laid_out, width, apart), dim, said, width)


def _laid(
    comparison: Comparison, column: Column, head: tuple[str, str], spread: bool = False, intervals: bool = True
) -> _Laid:
    cells = [words.shown(comparison, name, column, spread) for name in comparison.methods]
    cells = cells if intervals else [replace(cell, interval="") for cell in cells]
    return _Laid(head, cells, column.knows == "taste")


def _head(comparison: Comparison, chosen: Deciding) -> str:
    return f"{comparison.title}{'' if chosen.main is None else f', best {chosen.main.metric} first'}"


def _signs(comparison: Comparison, laid_out: Sequence[_Laid], over: Sequence[str]) -> str:
    """What the numbers and signs of a block mean. over: how many views."""
    cells = [cell for column in laid_out for cell in column.cells]
    parts = [f"differences from {comparison.baseline}" if comparison.baseline else "", *over]
    return "; ".join(filter(None, [*parts, *words.signs(comparison, cells, colours=True)]))


def _joined(head: str, tables: Sequence[Text], dim: Sequence[str], said: Sequence[str], width: int) -> Text:
    """One text. Lines are broken between words."""
    from rich.text import Text

    width = max(width, 20)  # a serial console says that it has no columns
    wrapper = textwrap.TextWrapper(width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
    below = [Text(wrapper.fill(line), style) for lines, style in ((dim, "dim"), (said, "")) for line in lines if line]
    return Text("\n").join([Text(wrapper.fill(head), "bold"), *tables, *below])


def _percent(comparison: Comparison, name: str, column: Column) -> str:
    """A share in per cent, never rounded up to all; a difference of shares with its sign, never rounded to none."""
    cell = comparison.cells.get((name, column))
    if cell is None:
        return "-"
    change = 100 * cell.change[0]
    if change == change:  # there is one
        return f"{change:+.0f}" if abs(change) >= 1 else words.signed(change)
    return f"{100 * cell.mean:.0f}" if not 0.995 <= cell.mean < 1 else "99"
