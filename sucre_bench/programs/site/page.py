"""The board as a page: no script, nothing from a network, every text escaped."""

import base64
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from sucre_bench.compare import Column
from sucre_bench.compare.words import left_out, legend, shown, title
from sucre_bench.machine.files import write_atomically
from sucre_bench.programs.site.board import Board, Line, Table


@dataclass(frozen=True)
class _Shown:
    """A row of a table: its cells are (text, look)."""

    line: Line
    cells: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class _Block:
    """A table as the template has it. notes: what is not counted, and on which pixels scores are if these differ."""

    dataset: str
    apart: str
    heads: tuple[tuple[str, str], ...]
    rows: tuple[_Shown, ...]
    legend: str
    notes: tuple[str, ...]


def write_page(folder: Path, board: Board, heading: str) -> Path:
    """Write ``folder/index.html`` and return its path. Raises OutputError if it cannot be written."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    pages = Environment(
        loader=PackageLoader("sucre_bench.programs.site", ""), autoescape=True, undefined=StrictUndefined
    )
    style = files("sucre_bench.programs.site").joinpath("page.css").read_text(encoding="utf-8")
    blocks = [_block(table) for table in board.tables]
    page = pages.get_template("page.html.j2").render(
        heading=heading,
        style=Markup(style),
        style_hash=base64.b64encode(hashlib.sha256(style.encode()).digest()).decode(),
        entries=board.entries,
        blocks=blocks,
        overview=list(_overview(board.tables)),
        datasets=list(dict.fromkeys(block.dataset for block in blocks)),
    )
    path = folder / "index.html"
    write_atomically(path, page.encode())
    return path


def _block(table: Table) -> _Block:
    compared = table.comparison
    lines = sorted(table.lines, key=lambda line: _place(table, line, compared.columns[0]))
    return _Block(
        table.dataset,
        table.apart,
        tuple((title(column), column.variant) for column in compared.columns),
        tuple(_Shown(line, tuple(_cells(table, line))) for line in lines),
        legend(compared),
        tuple(left_out(compared)),
    )


def _cells(table: Table, line: Line) -> Iterator[tuple[str, str]]:
    for column in table.comparison.columns:
        cell = shown(table.comparison, line.label, column)
        yield str(cell), cell.look


def _place(table: Table, line: Line, column: Column) -> int:
    """A method's place in a column; behind all others the photograph, and one without a score."""
    cell = table.comparison.cells.get((line.label, column))
    return (cell.place or len(table.lines) + 1) if cell else len(table.lines) + 2


def _overview(tables: tuple[Table, ...]) -> Iterator[tuple[str, dict[str, str]]]:
    """Methods x datasets: for each method its mean in the first column of each dataset's first table."""
    firsts = {table.dataset: table for table in reversed(tables)}
    methods = sorted({line.method for table in firsts.values() for line in table.lines})
    for method in methods:
        cells: dict[str, str] = {}
        for dataset, table in firsts.items():
            column = table.comparison.columns[0]
            of_method = [line for line in table.lines if line.method == method]
            if of_method:
                places = [_place(table, line, column) for line in of_method]
                best = shown(table.comparison, of_method[places.index(min(places))].label, column)
                cells[dataset] = " ".join(filter(None, [best.mark, best.value, column.metric]))
        yield method, cells
