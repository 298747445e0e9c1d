"""Puts the methods of many bundles into tables. Results that may not be compared get separate tables.

A table has one dataset in one state of its data. It has the same images for all methods, and for each column one
variant and one version of its metric. What does not fit a table begins another one, with the reason. Seconds and memory
are left out, since bundles come from different machines, and so are metrics that are not registered here.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Any

from sucre_bench import compare, plugins
from sucre_bench.arrays import DataFrame
from sucre_bench.compare import Column, Comparison
from sucre_bench.compare.words import deciding, left_out, legend, shown, title
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.text_formats import filled_in
from sucre_bench.results.common_scores import common_frame
from sucre_bench.results.rows import RESTORATION


class State(Enum):
    """What `verify` found; the value is what the page says."""

    VERIFIED = "verified"
    PARTLY = "in part"
    HASHES = "hashes hold"
    DIFFERS = "differs"


@dataclass(frozen=True, eq=False)
class Entry:
    """A bundle on the board.

    file: its name; id, by, version: see `Bundle`; checked: how many scores were computed again and agree, of how many;
    fault: the first thing that differs, or why the file is no bundle; rows: its score table, None without one;
    common: its scores on common pixels, None without any.
    """

    file: str
    id: str
    by: str
    version: str
    state: State
    checked: tuple[int, int]
    fault: str
    rows: DataFrame | None
    common: DataFrame | None = None

    @property
    def who(self) -> str:
        """Who publishes it, or else the file's name."""
        return self.by or self.file

    @property
    def check(self) -> str:
        """What the check found, with the number of scores if not all were computed again."""
        count = f": {self.checked[0]} of {self.checked[1]}" if self.state is State.PARTLY else ""
        return f"{self.state.value}{count}"


@dataclass(frozen=True)
class Line:
    """A row of a table: a method of a bundle. label: its name in the comparison."""

    label: str
    method: str
    entry: Entry


@dataclass(frozen=True, eq=False)
class Table:
    """Methods that may be compared. apart: why they do not stand in the table before, "" for a dataset's first."""

    dataset: str
    lines: tuple[Line, ...]
    comparison: Comparison
    apart: str


def board(entries: Sequence[Entry]) -> list[Table]:
    """Return the tables of bundles of which nothing differs, by dataset. Copies of a bundle stand in them once."""
    import pandas as pd

    once = {e.id: e for e in reversed(entries) if e.rows is not None and e.state is not State.DIFFERS}
    groups: dict[str, list[_Group]] = {}  # by dataset
    for entry in sorted(once.values(), key=entries.index):
        assert entry.rows is not None
        rows = entry.rows[entry.rows["metric"].isin([*plugins.usable("metric"), RESTORATION])]
        for dataset, of_dataset in rows.groupby("dataset", sort=False):
            _add(groups.setdefault(str(dataset), []), entry, of_dataset)
    tables = []
    for name, group in ((dataset, group) for dataset in sorted(groups) for group in groups[dataset]):
        common = partial(pd.concat, group.common, ignore_index=True)
        for comparison in compare.compare(compare.on_pixels(group.rows, common)):
            columns = dict.fromkeys((*deciding(comparison).columns, *comparison.columns))  # those that decide first
            if ranked := tuple(column for column in columns if column.ranked):
                chosen = compare.only(comparison, [f"{column.metric}:{column.variant}" for column in ranked])
                tables.append(Table(name, tuple(group.lines), replace(chosen, columns=ranked), group.apart))
    return tables


@dataclass
class _Group:
    """Methods that were found to be comparable so far. common: scores on common pixels, a table for each bundle."""

    rows: DataFrame
    common: list[DataFrame]
    lines: list[Line]
    apart: str


def _add(groups: list[_Group], entry: Entry, rows: DataFrame) -> None:
    """Add a bundle's methods to the first group that they may be compared with, or as a group of their own."""
    import pandas as pd

    labels = {name: f"{name} ({entry.who} {entry.id})" for name in rows["method"].unique()}
    lines = [Line(label, str(name), entry) for name, label in labels.items()]
    rows, common = rows.assign(method=rows["method"].map(labels)), common_frame([])
    if entry.common is not None:
        methods = [json.dumps([labels.get(n, n) for n in json.loads(text)]) for text in entry.common["methods"]]
        common = entry.common.assign(method=entry.common["method"].map(labels).fillna(""), methods=methods)
    reasons = []
    for group in groups:
        together = pd.concat([group.rows, rows], ignore_index=True)
        ids = [frame[frame["scene"] != ""].groupby("scene")["data_id"].first() for frame in (group.rows, rows)]
        shared = ids[0].index.intersection(ids[1].index)
        differing = shared[(ids[0][shared] != ids[1][shared]).to_numpy()]
        why = next((reason for _, reason in compare.refusals(together)), "")
        if len(differing):
            name = differing[0]
            why = f"other data: scene {name} is {ids[1][name]}, above {ids[0][name]}"
        if not why:
            group.rows = together
            group.common.append(common)
            group.lines += lines
            return
        reasons.append(why)
    groups.append(_Group(rows, [common], lines, next(iter(reasons), "")))


# -- the page: no script, nothing from a network, every text escaped --------------------------------------------------


def write_page(folder: Path, entries: Sequence[Entry], tables: Sequence[Table], heading: str) -> Path:
    """Write ``folder/index.html`` and return its path. Raises OutputError if it cannot be written."""
    blocks: list[dict[str, Any]] = []
    for table in tables:
        compared, columns = table.comparison, table.comparison.columns
        lines = sorted(table.lines, key=partial(_place, table, columns[0]))
        blocks.append(
            {
                "dataset": table.dataset,
                "apart": table.apart,
                "heads": [(title(column), column.variant) for column in columns],
                "rows": [(line, [shown(compared, line.label, column) for column in columns]) for line in lines],
                "legend": legend(compared),
                "notes": left_out(compared),
            }
        )
    page = filled_in(
        __package__,
        "page.html.j2",
        heading=heading,
        entries=entries,
        blocks=blocks,
        overview=list(_overview(tables)),
        datasets=list(dict.fromkeys(table.dataset for table in tables)),
    )
    write_atomically(folder / "index.html", page)
    return folder / "index.html"


def _place(table: Table, column: Column, line: Line) -> int:
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
                first = min(of_method, key=partial(_place, table, column))
                best = shown(table.comparison, first.label, column)
                cells[dataset] = " ".join(filter(None, [best.mark, best.value, column.metric]))
        yield method, cells
