"""A comparison for the terminal: the columns that decide, or every column; of many datasets, one score of each."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from sucre_bench.arrays import DataFrame
from sucre_bench.compare import words
from sucre_bench.compare.model import Comparison
from sucre_bench.compare.words import Part, Shown, best_first, deciding

if TYPE_CHECKING:
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

_STYLE = {
    "best": "bold green",
    "second": "underline",
    "better": "bold green",
    "worse": "red",
    "dim": "dim",
}
# characters that the names of methods have at least; longer ones are folded
_SHORTEST_NAMES = 20
_MOST_BLOCKS = 3  # comparisons with a block of their own


def as_blocks(
    comparisons: Sequence[Comparison],
    width: int,
    every: bool = False,
    intervals: bool = False,
    spread: bool = False,
) -> list[Group]:
    """Return what rich prints for each comparison; of many datasets a table a score, with a column a dataset.

    every: all columns, not only those that decide; intervals: with 95 % intervals; spread: with standard deviations.
    """
    if len(comparisons) > _MOST_BLOCKS and not intervals and not spread:
        keys = dict[str, None]()
        for comparison in comparisons:
            chosen = deciding(comparison)
            shown = (chosen.main,) if chosen.main else chosen.columns
            if every:
                shown = comparison.columns
            keys |= dict.fromkeys(column.key for column in shown if column.directed)
        return [_overview(comparisons, key, width) for key in keys]
    return [as_table(one, width, every, intervals, spread) for one in comparisons]


def as_table(
    comparison: Comparison,
    width: int,
    every: bool = True,
    intervals: bool = True,
    spread: bool = False,
) -> Group:
    """Return what rich prints of one comparison, the best method first and the photograph last; see `as_blocks`."""
    chosen = deciding(comparison)
    methods = best_first(comparison, chosen.main)
    block = replace(comparison, methods=methods)
    if not every:
        block = block.with_columns(chosen.columns)
    cells = words.shown_table(
        methods, words.parts_of(block, with_variants=every), spread, intervals
    )
    head = block.title
    if chosen.main:
        head += f", best {chosen.main.metric} first"
    dim = [words.legend(block, cells, spread), *words.left_out(block)]
    return _joined(head, _tables(cells, width), dim, words.answer(block), width)


def _overview(comparisons: Sequence[Comparison], key: str, width: int) -> Group:
    """One score of every dataset that has it: a line a method, a column a dataset. key: of its column."""
    found = [
        (one, column) for one in comparisons for column in one.columns if column.key == key
    ]
    methods = dict[str, None]()
    for one, _ in found:
        methods |= dict.fromkeys(best_first(one, deciding(one).main))
    # of "sea,noise=0.1" the option alone, where all are of the sea
    names = {one.title.partition(",")[0] for one, _ in found}
    where = min(names) if len(names) == 1 else ""
    parts = [Part(one.title.removeprefix(f"{where},"), one, column) for one, column in found]
    cells = words.shown_table([*methods], parts, intervals=False)
    first, column = found[0]
    dim = [words.legend(first.with_columns([column]), cells)]
    differing = sum(any("pixels" in note.kind for note in one.notes) for one, _ in found)
    if differing:
        dim.append(f"in {differing} of {len(found)} tables methods fill different pixels")
    head = f"{words.title(column)} ({column.variant}) of {len(found)} tables: {where}".rstrip(
        ": "
    )
    said = () if deciding(first).knows_colours else words.BLIND
    return _joined(head, _tables(cells, width), dim, said, width)


def _tables(cells: DataFrame, width: int) -> list[Table]:
    """Tables of as many columns as fit beside each other."""
    from rich.table import Table
    from rich.text import Text

    texts = [_texts([*column]) for _, column in cells.items()]
    widths = [
        max(map(len, [*head.split("\n"), *column]))
        for head, column in zip(cells.columns, texts, strict=True)
    ]
    longest = max(map(len, ["method", *cells.index]))
    first = min(longest, max(width - max(widths, default=0) - 2, _SHORTEST_NAMES))
    made = []
    for places in _blocks(widths, width - first):
        table = Table(box=None, pad_edge=False, collapse_padding=True, padding=(0, 2, 0, 0))
        table.add_column("method", width=first, overflow="fold")
        for head in cells.columns[places]:
            name, _, unit = head.partition("\n")
            lines = Text.assemble((name, "bold"), (f"\n{unit}", "not bold dim"))
            table.add_column(lines, justify="right", no_wrap=True)
        for name, *line in zip(cells.index, *texts[places], strict=True):
            table.add_row(Text(name), *line)
        made.append(table)
    return made


def _texts(cells: Sequence[Shown]) -> list[Text]:
    """A column's cells: what follows a number is as wide in each, so that numbers stand below each other."""
    from rich.text import Text

    rests = [" ".join(filter(None, [cell.interval, cell.holes])) for cell in cells]
    widest = max(map(len, rests))
    lines = []
    for cell, rest in zip(cells, rests, strict=True):
        line = Text()
        line.append(f"{cell.mark} {cell.value}".lstrip(), _STYLE.get(cell.look, ""))
        if widest:
            line.append(f" {rest:<{widest}}", "dim")
        lines.append(line)
    return lines


def _blocks(widths: Sequence[int], room: int) -> list[slice]:
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


def _joined(
    head: str, tables: Sequence[Table], dim: Sequence[str], said: Sequence[str], width: int
) -> Group:
    """All in one. Lines are broken between words."""
    from rich.console import Group
    from rich.text import Text

    width = max(width, 20)  # a serial console says that it has no columns
    wrapper = textwrap.TextWrapper(
        width, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )
    below = [Text(wrapper.fill(line), "dim") for line in dim]
    below += [Text(wrapper.fill(line)) for line in said]
    return Group(Text(wrapper.fill(head), "bold"), *tables, *below)
