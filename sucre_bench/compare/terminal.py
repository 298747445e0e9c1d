"""A comparison as a table for the terminal, in blocks of as many columns as fit, with numbers aligned."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sucre_bench.compare import Column, Comparison
from sucre_bench.compare.words import Shown, blocks, left_out, legend, shown, title

if TYPE_CHECKING:
    from rich.console import RenderableType

__all__ = ["as_table"]

_STYLE = {"best": "bold green", "second": "underline", "better": "green", "worse": "red"}


def as_table(comparison: Comparison, width: int, spread: bool = False) -> RenderableType:
    """Return a rich renderable: blocks of as many columns as `width` characters have room for.

    spread: with standard deviations.
    """
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    first = max(len(name) for name in ("method", *comparison.methods))
    laid_out = [_LaidOut.of(comparison, column, spread) for column in comparison.columns]
    parts: list[Any] = [Text(comparison.title, style="bold")]
    for places in blocks([own.width for own in laid_out], width - first - 2):
        block = laid_out[places]
        lines = Table(box=None, header_style="bold", pad_edge=False, padding=(0, 2, 0, 0))
        lines.add_column("method", no_wrap=True)
        for own in block:
            head = Text(f"{title(own.column):>{own.width}}\n").append(f"{own.column.variant:>{own.width}}", style="dim")
            lines.add_column(head, no_wrap=True)
        for n, name in enumerate(comparison.methods):
            lines.add_row(Text(name), *(own.painted(n) for own in block))
        parts += [lines, Text("")]
    parts += [Text(line, style="dim") for line in (legend(comparison, spread, colours=True), *left_out(comparison))]
    return Group(*parts)


@dataclass(frozen=True)
class _LaidOut:
    """A column's cells, and how wide each of their parts is."""

    column: Column
    cells: tuple[Shown, ...]
    value: int
    interval: int
    holes: int

    @classmethod
    def of(cls, comparison: Comparison, column: Column, spread: bool) -> _LaidOut:
        cells = tuple(shown(comparison, name, column, spread) for name in comparison.methods)
        return cls(
            column,
            cells,
            max(len(_marked(cell)) for cell in cells),
            max(len(cell.interval) for cell in cells),
            max(len(cell.holes) for cell in cells),
        )

    @property
    def width(self) -> int:
        return max(len(title(self.column)), len(self.column.variant), self._of_cells)

    @property
    def _of_cells(self) -> int:
        return self.value + sum(1 + own for own in (self.interval, self.holes) if own)

    def painted(self, n: int) -> Any:
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
