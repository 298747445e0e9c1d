"""Lays out columns of numbers in blocks that fit into a terminal or a page."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from sucre_bench.compare.model import Column, Comparison
from sucre_bench.compare.words import Shown, shown

if TYPE_CHECKING:
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
