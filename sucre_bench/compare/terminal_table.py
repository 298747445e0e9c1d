"""A comparison for the terminal: one block with the columns that decide, or a table of every column."""

from __future__ import annotations

import itertools
import re
import textwrap
from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import replace
from statistics import fmean
from typing import TYPE_CHECKING

from sucre_bench.compare import words
from sucre_bench.compare.model import Column, Comparison
from sucre_bench.compare.words import (
    Deciding,
    ShownColumn,
    answer,
    best_first,
    deciding,
    verdicts,
)

if TYPE_CHECKING:
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

_STYLE = {"best": "bold green", "second": "underline", "better": "green", "worse": "red"}
# characters that the names of methods have at least; longer ones are folded
_SHORTEST_NAMES = 20
_MOST_BLOCKS = 3  # comparisons with a block of their own


def _texts(column: ShownColumn) -> list[Text]:
    """A column's cells: numbers, intervals and holes stand each below those of the cells above."""
    from rich.text import Text

    interval_width = max(len(cell.interval) for cell in column.cells)
    holes_width = max(len(cell.holes) for cell in column.cells)
    lines = []
    for cell in column.cells:
        value = f"{cell.mark} {cell.value}".lstrip()
        style = _STYLE.get(cell.look, "dim" if cell.mark or column.is_dim else "")
        line = Text().append(value, style)
        for part, width in ((cell.interval, interval_width), (cell.holes, holes_width)):
            if width:
                line.append(f" {part:<{width}}", "dim")
        lines.append(line)
    return lines


def _tables(
    methods: Sequence[str],
    columns: Sequence[ShownColumn],
    width: int,
    dim: Collection[str] = (),
) -> list[Table]:
    """Tables of as many columns as fit beside each other. dim: methods whose names are set so."""
    from rich.table import Table
    from rich.text import Text

    texts = [_texts(column) for column in columns]
    widths = [
        max(len(column.head), len(column.unit), *map(len, each))
        for column, each in zip(columns, texts, strict=True)
    ]
    longest = max(len(name) for name in ("method", *methods))
    first = min(longest, max(width - max(widths, default=0) - 2, _SHORTEST_NAMES))
    made = []
    for places in blocks(widths, width - first):
        table = Table(box=None, pad_edge=False, collapse_padding=True, padding=(0, 2, 0, 0))
        table.add_column("method", width=first, overflow="fold")
        for column in columns[places]:
            head = Text(column.head, "dim" if column.is_dim else "bold")
            table.add_column(head, justify="right", no_wrap=True)
        if any(column.unit for column in columns[places]):
            table.add_row("", *(Text(column.unit, "dim") for column in columns[places]))
        for name, *cells in zip(methods, *texts[places], strict=True):
            table.add_row(Text(name, "dim" if name in dim else ""), *cells)
        made.append(table)
    return made


def blocks(widths: Sequence[int], room: int) -> list[slice]:
    """Return which columns stand beside each other: as many as fit into `room` characters, two between them.

    A column wider than `room` stands alone.
    """
    ends = [0]
    left = room
    for n, width in enumerate(widths):
        if n > ends[-1] and width + 2 > left:
            ends.append(n)
            left = room
        left -= width + 2
    return [slice(*pair) for pair in itertools.pairwise([*ends, len(widths)])] if widths else []


def as_table(
    comparison: Comparison, width: int, spread: bool = False, intervals: bool = True
) -> Group:
    """Return what rich prints: all columns, in blocks of as many as `width` characters have room for.

    The methods are in the order of `as_blocks`, and lines are broken between words. spread: with standard deviations;
    intervals: with 95 % intervals, and a sentence for each lead.
    """
    chosen = deciding(comparison)
    comparison = replace(comparison, methods=best_first(comparison, chosen.main))
    laid_out = [
        words.shown_column(
            comparison, column, words.title(column), column.variant, spread, intervals
        )
        for column in comparison.columns
    ]
    dim = [
        words.legend(comparison, spread, colours=True, intervals=intervals),
        *words.left_out(comparison),
    ]
    judged = verdicts(comparison) if intervals else ()
    said = [words.verdict_text(comparison, verdict) for verdict in judged]
    said = words.framed(comparison, chosen, said)
    tables = _tables(comparison.methods, laid_out, width)
    return _joined(comparison.title, tables, dim, said, width, chosen.main)


def as_blocks(
    comparisons: Sequence[Comparison], width: int, every: bool = False
) -> list[Group]:
    """Return what rich prints for each comparison; one table for all those of many datasets with the same main score.

    every: all columns, not only those that decide; of many datasets a table a column.
    """
    by_first = defaultdict[str, list[tuple[Comparison, Deciding]]](list)
    for comparison in words.notes_once(comparisons):
        chosen = deciding(comparison, every)
        first = chosen.main or next((one for one in chosen.scores if one.directed), None)
        by_first[first.key if first else ""].append((comparison, chosen))
    made: list[Group] = []
    for main, group in by_first.items():
        if main and len(group) > _MOST_BLOCKS:
            of_many = [one for one, _ in group]
            keys = dict.fromkeys(column.key for one in of_many for column in one.columns)
            made += [_overview(of_many, key, width) for key in (keys if every else [main])]
        else:
            made += [_block(*one, width, every) for one in group]
    return made


def _block(comparison: Comparison, chosen: Deciding, width: int, every: bool) -> Group:
    """The columns that decide, the best method first, and a verdict for each score.

    The photograph stands below the methods. Lines are broken between words, to `width` characters.
    """
    methods = best_first(comparison, chosen.main)
    block = replace(comparison.with_columns(chosen.columns), methods=methods)
    metrics = [column.metric for column in block.columns]
    laid_out = []
    for column in block.columns:
        variant = column.variant if metrics.count(column.metric) > 1 else ""
        unit = f"{variant} {column.unit}".strip()
        head = f"{column.metric} {words.ARROW[column.better]}".rstrip()
        laid = words.shown_column(block, column, head, unit, intervals=False)
        cells = [
            replace(cell, look="" if cell.look == "second" else cell.look)
            for cell in laid.cells
        ]
        laid = replace(laid, cells=cells)
        if column not in chosen.scores and not column.is_share_filled:
            laid = replace(laid, head="s/view", unit="")
        elif column not in chosen.scores:
            percents = [_percent(block, name, column) for name in methods]
            cells = [replace(cell, value=n) for cell, n in zip(cells, percents, strict=True)]
            laid = ShownColumn("filled", cells, "%", laid.is_dim)
        laid_out.append(laid)
    over = words.over_views(block.columns)
    over[:1] = [f"means {first}" for first in over[:1]]
    dim = [_signs(block, laid_out, over), *words.left_out(block)]
    tables = _tables(methods, laid_out, width, comparison.photographs)
    said = answer(block, deciding(comparison) if every else chosen)
    return _joined(block.title, tables, dim, said, width, chosen.main)


def _overview(comparisons: Sequence[Comparison], key: str, width: int) -> Group:
    """One score of every dataset that has it: a line a method, a column a dataset. key: of its column."""
    found = [
        (one, column) for one in comparisons for column in one.columns if column.key == key
    ]
    comparisons, mains = [one for one, _ in found], [column for _, column in found]
    blind = [one for one in comparisons if not deciding(one).knows_colours]
    places = defaultdict[str, list[int]](list)
    for one, column in found:
        main = column if column.ranked and not blind else None
        for place, name in enumerate(best_first(one, main)):
            places[name].append(place)
    apart = {name for one in comparisons if one.restorers for name in one.photographs}
    methods = [*places]
    if not blind:
        methods.sort(key=lambda name: (name in apart, fmean(places[name])))
    titles = [one.title for one in comparisons]
    letters = itertools.takewhile(lambda signs: len({*signs}) == 1, zip(*titles, strict=False))
    # up to the end of a word of a label
    prefix = re.sub(r"[^,=·/ ]*$", "", "".join(same[0] for same in letters))
    laid_out = [
        words.shown_column(
            replace(one, methods=tuple(methods)),
            column,
            one.title.removeprefix(prefix),
            intervals=False,
        )
        for one, column in zip(comparisons, mains, strict=True)
    ]
    views = [column.n_views for column in mains]
    ends = dict.fromkeys([str(min(views)), str(max(views))])
    dim = [_signs(comparisons[0], laid_out, [f"means over {' to '.join(ends)} views"])]
    kinds = [
        {note.kind for note in one.notes if {*note.columns} & {*mains}} for one in comparisons
    ]
    for kind, where in (
        ("common pixels", "on the pixels that all methods fill"),
        ("own pixels", "on own pixels"),
    ):
        if some := sum(kind in of_table for of_table in kinds):
            dim.append(
                f"in {some} of {len(titles)} tables methods fill different pixels; scores are {where}"
            )
    said = [text for one in blind[:1] for text in (one.blind, one.advice)]
    head = f"{words.title(mains[0])} ({mains[0].variant}) of {len(titles)} tables{': ' + prefix if prefix else ''}"
    return _joined(head, _tables(methods, laid_out, width, apart), dim, said, width)


def _signs(comparison: Comparison, laid_out: Sequence[ShownColumn], over: Sequence[str]) -> str:
    """What the numbers and signs of a block mean. over: how many views."""
    cells = [cell for column in laid_out for cell in column.cells]
    parts = [f"differences from {comparison.baseline}" if comparison.baseline else "", *over]
    return "; ".join(filter(None, [*parts, *words.signs(comparison, cells, colours=True)]))


def _joined(
    head: str,
    tables: Sequence[Table],
    dim: Sequence[str],
    said: Sequence[str],
    width: int,
    main: Column | None = None,
) -> Group:
    """All in one. Lines are broken between words. main: the score that sorts the methods."""
    from rich.console import Group
    from rich.text import Text

    head = f"{head}, best {main.metric} first" if main else head
    width = max(width, 20)  # a serial console says that it has no columns
    wrapper = textwrap.TextWrapper(
        width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )
    below = [Text(wrapper.fill(line), "dim") for line in dim if line]
    below += [Text(wrapper.fill(line)) for line in said if line]
    return Group(Text(wrapper.fill(head), "bold"), *tables, *below)


def _percent(comparison: Comparison, name: str, column: Column) -> str:
    """A share in per cent, never rounded up to all; a difference of shares with its sign, never rounded to none."""
    cell = comparison.cells.get((name, column))
    if cell is None:
        return "-"
    change = 100 * cell.change[0]
    if change == change:  # there is one
        return f"{change:+.0f}" if abs(change) >= 1 else words.signed(change)
    return f"{100 * cell.mean:.0f}" if not 0.995 <= cell.mean < 1 else "99"
