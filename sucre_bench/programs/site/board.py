"""Puts the methods of many bundles into tables. Results that may not be compared get separate tables.

A table has one dataset in one state of its data, the same images for all methods, and for each column one variant and
one version of its metric. What does not fit a table begins another one, with the reason. Seconds and memory are left
out, since bundles come from different machines, and so are metrics that are not registered here.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum

from sucre_bench import compare, plugins
from sucre_bench.arrays import DataFrame
from sucre_bench.compare import Comparison
from sucre_bench.compare.answer import decisive
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
        return (
            f"{self.state.value}: {self.checked[0]} of {self.checked[1]}"
            if self.state is State.PARTLY
            else self.state.value
        )


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


@dataclass(frozen=True, eq=False)
class Board:
    """entries: all bundles; tables: of those of which nothing differs, by dataset."""

    entries: tuple[Entry, ...]
    tables: tuple[Table, ...]


def board(entries: Sequence[Entry]) -> Board:
    """Make the tables of all bundles. Copies of one bundle stand in them once."""
    once = {e.id: e for e in reversed(entries) if e.rows is not None and e.state is not State.DIFFERS}
    usable = sorted(once.values(), key=entries.index)
    datasets = sorted({str(name) for entry in usable for name in _rows(entry)["dataset"].unique()})
    return Board(tuple(entries), tuple(table for name in datasets for table in _tables(name, usable)))


def _rows(entry: Entry) -> DataFrame:
    assert entry.rows is not None
    return entry.rows[entry.rows["metric"].isin([*plugins.usable("metric"), RESTORATION])]


@dataclass
class _Group:
    """Methods that were found to be comparable so far. common: scores on common pixels, a table for each bundle."""

    rows: DataFrame
    common: list[DataFrame]
    lines: list[Line]
    apart: str


def _tables(dataset: str, entries: Sequence[Entry]) -> Iterator[Table]:
    import pandas as pd

    groups: list[_Group] = []
    for entry in entries:
        rows = _rows(entry)
        rows = rows[rows["dataset"] == dataset]
        if rows.empty:
            continue
        lines = {
            str(name): Line(f"{name} ({entry.who} {entry.id})", str(name), entry) for name in rows["method"].unique()
        }
        labels = {name: line.label for name, line in lines.items()}
        _add(groups, rows.assign(method=rows["method"].map(labels)), _labelled(entry.common, labels), lines)
    for group in groups:
        compared = compare.compare(compare.on_pixels(group.rows, pd.concat(group.common, ignore_index=True)))
        for comparison in compared:
            columns = dict.fromkeys((*decisive(comparison).columns, *comparison.columns))  # those that decide first
            ranked = tuple(column for column in columns if column.ranked)
            if ranked:
                chosen = compare.only(comparison, [f"{column.metric}:{column.variant}" for column in ranked])
                yield Table(dataset, tuple(group.lines), replace(chosen, columns=ranked), group.apart)


def _labelled(common: DataFrame | None, labels: Mapping[str, str]) -> DataFrame:
    """A bundle's scores on common pixels, with the methods' labels on the board."""
    if common is None:
        return common_frame([])
    names = [json.dumps([labels.get(name, name) for name in json.loads(text)]) for text in common["methods"]]
    return common.assign(method=common["method"].map(labels).fillna(""), methods=names)


def _add(groups: list[_Group], rows: DataFrame, common: DataFrame, lines: dict[str, Line]) -> None:
    """Add a bundle's methods to the first group that they may be compared with, or as a group of their own."""
    import pandas as pd

    reason = ""
    for group in groups:
        together = pd.concat([group.rows, rows], ignore_index=True)
        why = _refusal(group.rows, rows, together)
        if not why:
            group.rows = together
            group.common.append(common)
            group.lines += lines.values()
            return
        reason = reason or why
    groups.append(_Group(rows, [common], list(lines.values()), reason))


def _refusal(one: DataFrame, other: DataFrame, together: DataFrame) -> str:
    """Why two tables may not stand in one, "" if they may."""
    ids = [frame[frame["scene"] != ""].groupby("scene")["data_id"].first() for frame in (one, other)]
    shared = ids[0].index.intersection(ids[1].index)
    differing = shared[(ids[0][shared] != ids[1][shared]).to_numpy()]
    if len(differing):
        name = differing[0]
        return f"other data: scene {name} is {ids[1][name]}, above {ids[0][name]}"
    return next((refusal.text for refusal in compare.refusals(together)), "")
