"""The board as a page: no script, nothing from a network, every text escaped."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from sucre_bench.compare import Column
from sucre_bench.compare.words import left_out, legend, shown, title
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.text_formats import filled_in
from sucre_bench.programs.site.board import Entry, Line, Table


def write_page(folder: Path, entries: Sequence[Entry], tables: Sequence[Table], heading: str) -> Path:
    """Write ``folder/index.html`` and return its path. Raises OutputError if it cannot be written."""
    page = filled_in(
        __package__,
        "page.html.j2",
        heading=heading,
        entries=entries,
        blocks=[_block(table) for table in tables],
        overview=list(_overview(tables)),
        datasets=list(dict.fromkeys(table.dataset for table in tables)),
    )
    write_atomically(folder / "index.html", page)
    return folder / "index.html"


def _block(table: Table) -> dict[str, Any]:
    """A table as the template has it: its lines in the order of the first column, each with what its cells show."""
    compared = table.comparison
    lines = sorted(table.lines, key=lambda line: _place(table, line, compared.columns[0]))
    return {
        "dataset": table.dataset,
        "apart": table.apart,
        "heads": [(title(column), column.variant) for column in compared.columns],
        "rows": [(line, [shown(compared, line.label, column) for column in compared.columns]) for line in lines],
        "legend": legend(compared),
        "notes": left_out(compared),
    }


def _place(table: Table, line: Line, column: Column) -> int:
    """A method's place in a column; behind all others the photograph, and one without a score."""
    cell = table.comparison.cells.get((line.label, column))
    return (cell.place or len(table.lines) + 1) if cell else len(table.lines) + 2


def _overview(tables: Sequence[Table]) -> Iterator[tuple[str, dict[str, str]]]:
    """Methods x datasets: for each method its mean in the first column of each dataset's first table."""
    firsts = {table.dataset: table for table in reversed(tables)}
    methods = sorted({line.method for table in firsts.values() for line in table.lines})
    for method in methods:
        cells: dict[str, str] = {}
        for dataset, table in firsts.items():
            column = table.comparison.columns[0]
            if of_method := [line for line in table.lines if line.method == method]:
                first = min(of_method, key=lambda line: _place(table, line, column))
                best = shown(table.comparison, first.label, column)
                cells[dataset] = " ".join(filter(None, [best.mark, best.value, column.metric]))
        yield method, cells
