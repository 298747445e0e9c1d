"""A comparison for papers and programs: Markdown, LaTeX (booktabs), CSV, JSON."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from sucre_bench.arrays import DataFrame
from sucre_bench.compare.model import Cell, Column, Comparison, Difference
from sucre_bench.compare.words import (
    Part,
    Shown,
    answer,
    left_out,
    legend,
    parts_of,
    shown_table,
    title,
)
from sucre_bench.machine.text_formats import json_text
from sucre_bench.results.rows import COSTS, csv_text

Format = Literal["md", "latex", "csv", "json"]


def as_text(comparisons: Sequence[Comparison], how: Format, spread: bool = False) -> str:
    """Return all tables as one text: CSV and JSON a record a cell, the others a table each, titled if several.

    spread: tables show standard deviations too, which records always have. LaTeX needs the package booktabs.
    """
    if how in ("csv", "json"):
        records = [record for comparison in comparisons for record in _records(comparison)]
        if how == "json":
            return json_text(records) + "\n"
        import pandas as pd

        return csv_text(pd.DataFrame(records), for_spreadsheets=True)
    made = []
    for one in comparisons:
        cells = shown_table(one.methods, parts_of(one, with_variants=True), spread)
        head = one.title if len(comparisons) > 1 else ""
        below = [*answer(one), legend(one, cells, spread), *left_out(one)]
        made.append(_WRITERS[how](head, cells, below))
    return "\n".join(made)


def levels_as_text(tables: Mapping[str, Sequence[Level]], how: Literal["md", "latex"]) -> str:
    """Return a table a score: methods are its lines, the levels of an option its columns.

    tables: the levels of each table by its title. Ranks are of a level: nobody compares methods at unlike noise.
    """
    made = []
    for title_of, levels in tables.items():
        first = levels[0].comparison
        for column in first.columns:
            parts = [
                Part(level.name, level.comparison, column, level.lines) for level in levels
            ]
            cells = shown_table([*levels[0].lines], parts)
            head = f"{title_of}: {title(column)} ({column.variant})"
            below = [legend(first.with_columns([column]), cells)]
            if column == first.columns[-1]:
                below += left_out(first)
            made.append(_WRITERS[how](head, cells, below))
    return "\n".join(made)


@dataclass(frozen=True)
class Level:
    """A column of a table of levels: its heading, the comparison it is of, and what that calls each method."""

    name: str
    comparison: Comparison
    lines: Mapping[str, str]


def without_costs(comparison: Comparison) -> Comparison:
    """Return a comparison without seconds and memory, which papers do not print."""
    columns = tuple(column for column in comparison.columns if column.metric not in COSTS)
    return replace(comparison, columns=columns)


def _records(comparison: Comparison) -> Iterator[dict[str, Any]]:
    """A record a cell. filled: the share of the image that the method fills; NaN if that is in no column."""
    filled = {n: cell.mean for (n, c), cell in comparison.cells.items() if c.is_share_filled}
    for name in comparison.methods:
        for column in comparison.columns:
            cell = comparison.cells.get((name, column))
            if cell is None:
                continue
            record = {
                "table": comparison.title,
                "method": name,
                **fields_of(column, "metric", "variant", "unit", "better"),
                **fields_of(cell, "mean", "std", "low", "high", "place", "rank"),
                "tie_with_best": cell.tie,
                **ends_of("behind", cell.behind),
                **fields_of(cell, "wins", "effect", "holes"),
                **fields_of(column, "n_units", "n_views", "n_scenes"),
                "knows": None if column.is_unknown else column.knows,
                "pixels": column.pixels,
                "filled": filled.get(name, math.nan),
            }
            if comparison.baseline:
                record |= {"baseline": comparison.baseline, **ends_of("change", cell.change)}
            yield record


def fields_of(one: Column | Cell, *names: str) -> dict[str, Any]:
    """Return fields by name, as records have them."""
    return {name: getattr(one, name) for name in names}


def ends_of(name: str, difference: Difference) -> dict[str, float]:
    """Return a difference and the ends of its interval, as records have them."""
    return dict(zip((name, f"{name}_low", f"{name}_high"), difference, strict=True))


def _marked(
    cells: DataFrame,
    best: str,
    second: str,
    escaped: Callable[[str], str],
) -> DataFrame:
    """The cells of a table as text. best, second: what stands around such a cell; escaped: of names and numbers."""
    marks = {"best": best, "better": best, "second": second}

    def marked(cell: Shown) -> str:
        return marks.get(cell.look, "{}").format(escaped(str(cell)))

    heads = [escaped(head.replace("\n", " ")) for head in cells.columns]
    table = cells.map(marked).set_axis(heads, axis="columns")
    return table.set_axis([escaped(name) for name in cells.index]).rename_axis("method", axis=1)


def _markdown(title: str, cells: DataFrame, notes: Sequence[str]) -> str:
    def plain(text: str) -> str:
        # a label is no markup
        return re.sub(r"([*`\\|])", r"\\\1", html.escape(text, quote=False))

    table = _marked(cells, "**{}**", "<u>{}</u>", plain)
    lines = [["method", *table.columns], ["---", *["---:"] * len(table.columns)]]
    for name, row in zip(table.index, table.to_numpy(), strict=True):
        lines.append([name, *row])
    text = ""
    if title:
        text = f"**{plain(title)}**\n\n"
    for line in lines:
        text += f"| {' | '.join(line)} |\n"
    for note in notes:
        text += f"\n{plain(note)}\n"
    return text


_TEX = str.maketrans({
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "<": "$<$", ">": "$>$", "|": "$|$", '"': "''",
    "↑": r"$\uparrow$", "↓": r"$\downarrow$", "≈": r"$\approx$", "±": r"$\pm$", "○": r"$\circ$", "·": r"$\cdot$",
    **{sign: "\\" + sign for sign in "_%&#${}"},
})  # fmt: skip


def _latex(title: str, cells: DataFrame, notes: Sequence[str]) -> str:
    table = _marked(
        cells,
        r"\textbf{{{}}}",
        r"\underline{{{}}}",
        lambda text: " ".join(text.split()).translate(_TEX),
    )
    # signs of numbers as mathematics has them
    table = table.replace(r"[+-](?=\d|\.|inf)", r"$\g<0>$", regex=True)
    # after \\ and \midrule, brackets and stars are their options
    table.index = table.index.str.replace(r"^(?=[\[*(])", "{}", regex=True)
    text = table.style.to_latex(hrules=True, column_format="l" + "r" * len(table.columns))
    # a comment ends with its line
    if title:
        text = f"% {' '.join(title.split())}\n{text}"
    for note in notes:
        text += f"% {' '.join(note.split())}\n"
    return text


_WRITERS = {"md": _markdown, "latex": _latex}
