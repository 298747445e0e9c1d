"""A comparison for papers and programs: Markdown, LaTeX (booktabs), HTML, CSV, JSON."""

from __future__ import annotations

import html
import math
import re
import unicodedata
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from sucre_bench.arrays import DataFrame
from sucre_bench.compare import COSTS, Cell, Column, Comparison
from sucre_bench.compare.model import Difference
from sucre_bench.compare.terminal_table import blocks
from sucre_bench.compare.words import (
    Shown,
    answer,
    deciding,
    faults,
    left_out,
    legend,
    name_in,
    notes_once,
    over_views,
    shown,
    signs,
    title,
)
from sucre_bench.machine.text_formats import json_text
from sucre_bench.results.rows import csv_text

_PAGE = 108  # characters that fit beside each other on a page of two columns, about 500 points

_Grid = list[list[tuple[str, str]]]  # lines of cells: a text, and what sets it apart

Format = Literal["md", "latex", "html", "csv", "json"]


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
    for one in notes_once(comparisons):
        heads = [f"{title(column)} ({column.variant})" for column in one.columns]
        cells = [
            [shown(one, name, column, spread) for column in one.columns] for name in one.methods
        ]
        head = one.title if len(comparisons) > 1 else ""
        made.append(_WRITERS[how](head, _grid(heads, one.methods, cells), _below(one, spread)))
    return "\n".join(made)


def levels_as_text(tables: Mapping[str, Sequence[Level]], how: Literal["md", "latex"]) -> str:
    """Return a table a score: methods are its lines, the levels of an option its columns.

    tables: the levels of each table by its title. Ranks are of a level: nobody compares methods at unlike noise.
    """
    made = []
    for title_of, levels in tables.items():
        comparisons = [level.comparison for level in levels]
        for column in comparisons[0].columns:
            cells = [
                [
                    shown(one, level.lines[name], column)
                    for one, level in zip(comparisons, levels, strict=True)
                ]
                for name in levels[0].lines
            ]
            grid = _grid([level.name for level in levels], [*levels[0].lines], cells)
            marks = signs(comparisons[0], [cell for line in cells for cell in line], colours=False)
            has_interval = any(cell.interval for line in cells for cell in line)
            of = "mean [95 % interval]" if has_interval else "mean"
            below = "; ".join([of, *over_views([column]), *marks])
            head = f"{title_of}: {title(column)} ({column.variant})"
            made.append(_WRITERS[how](head, grid, [below]))
        notes = left_out(comparisons[0])
        if notes and how == "md":
            made.append("\n".join(f"{note}\n" for note in notes))
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
            record: dict[str, Any] = {"table": comparison.title, "method": name}
            record |= fields_of(column, "metric", "variant", "unit", "better")
            record |= fields_of(cell, "mean", "std", "low", "high", "place", "rank")
            record |= {"tie_with_best": cell.tie, **ends_of("behind", cell.behind)}
            record |= fields_of(cell, "wins", "effect", "holes")
            record |= fields_of(column, "n_units", "n_views", "n_scenes", "knows", "pixels")
            record["filled"] = filled.get(name, math.nan)
            if comparison.baseline:
                record |= {"baseline": comparison.baseline, **ends_of("change", cell.change)}
            yield record


def fields_of(one: Column | Cell, *names: str) -> dict[str, Any]:
    """Return fields by name, as records have them."""
    return {name: getattr(one, name) for name in names}


def ends_of(name: str, difference: Difference) -> dict[str, float]:
    """Return a difference and the ends of its interval, as records have them."""
    return dict(zip((name, f"{name}_low", f"{name}_high"), difference, strict=True))


_LOOKS = {"best": "best", "better": "best", "second": "second"}


def _grid(heads: Sequence[str], methods: Sequence[str], cells: Sequence[Sequence[Shown]]) -> _Grid:
    """The texts of a table and what sets each apart: a line with the headings, then a line a method."""
    lines = [[("method", ""), *((head, "") for head in heads)]]
    for name, line in zip(methods, cells, strict=True):
        lines.append([(name, ""), *((str(cell), _LOOKS.get(cell.look, "")) for cell in line)])
    return lines


def _below(comparison: Comparison, spread: bool) -> list[str]:
    """The notes below a table; with a baseline, also in how many views each method beats it, and the effect."""
    knows = deciding(comparison, every=True).knows_colours
    lines = faults(comparison) if knows else answer(comparison, deciding(comparison))
    lines.append(legend(comparison, spread))
    for name in comparison.methods if comparison.baseline else ():
        parts = [
            f"{name_in(comparison, c)} {round(cell.wins, 1):g}/{c.n_views}"
            + (f", effect {cell.effect:.1f}" if math.isfinite(cell.effect) else "")
            for c in comparison.columns
            if c.ranked and (cell := comparison.cells.get((name, c))) and math.isfinite(cell.wins)
        ]
        if parts:
            lines.append(f"{name} better than {comparison.baseline} in views: {'; '.join(parts)}")
    return lines + left_out(comparison)


# How each format sets a cell apart.
_MARKS = {
    "md": {"best": "**{}**", "second": "<u>{}</u>", "": "{}"},
    "html": {"best": "<strong>{}</strong>", "second": "<u>{}</u>", "": "{}"},
    "latex": {"best": r"\textbf{{{}}}", "second": r"\underline{{{}}}", "": "{}"},
}


def _marked(
    grid: _Grid,
    how: str,
    escaped: Callable[[str], str],
    number: Callable[[str], str] | None = None,
) -> DataFrame:
    """The cells of a table as a format has them, a line a method, whose name is the index.

    number: makes text of a number and its interval, as `escaped` by default.
    """
    import pandas as pd

    (corner, *heads), *rows = grid
    marks = _MARKS[how]
    return pd.DataFrame(
        [
            [marks[look].format((number or escaped)(text)) for text, look in cells]
            for _, *cells in rows
        ],
        index=[escaped(name) for (name, _), *_ in rows],
        columns=pd.Index([escaped(text) for text, _ in heads], name=corner[0]),
    )


def _markdown(title: str, grid: _Grid, notes: Sequence[str]) -> str:
    def plain(text: str) -> str:
        # a label is no markup
        return re.sub(r"([*`\[\]\\|])", r"\\\1", html.escape(text, quote=False))

    cells = _marked(grid, "md", plain, number=str)
    lines = [[cells.columns.name, *cells.columns], ["---", *["---:"] * len(cells.columns)]]
    lines += [[name, *row] for name, row in zip(cells.index, cells.to_numpy(), strict=True)]
    head = f"**{plain(title)}**\n\n" if title else ""
    table = "".join(f"| {' | '.join(line)} |\n" for line in lines)
    return head + table + "".join(f"\n{plain(note)}\n" for note in notes)


def _html(title: str, grid: _Grid, notes: Sequence[str]) -> str:
    table = _marked(grid, "html", html.escape).style
    if title:
        table = table.set_caption(html.escape(title))
    below = "".join(f"<p>{html.escape(note)}</p>\n" for note in notes)
    return table.to_html(exclude_styles=True) + below


# -- LaTeX -------------------------------------------------------------------------------------------------


def _latex(title: str, grid: _Grid, notes: Sequence[str]) -> str:
    names, *columns = zip(*grid, strict=True)
    widths = [max(len(text) for text, _ in column) for column in columns]
    room = _PAGE - max(len(text) for text, _ in names)
    cells = _marked(grid, "latex", _tex)
    # signs of numbers as mathematics has them
    cells = cells.replace(r"[+-](?=\d|\.|inf)", r"$\g<0>$", regex=True)
    # after \\ and \midrule, brackets and stars are their options
    cells.index = cells.index.str.replace(r"^(?=[\[*(])", "{}", regex=True)
    parts = [cells.iloc[:, places] for places in blocks(widths, room) or [slice(0)]]
    tabulars = [
        part.style.to_latex(hrules=True, column_format="l" + "r" * len(part.columns))
        for part in parts
    ]
    # a comment ends with its line
    head, *below = [f"% {' '.join(line.split())}\n" if line else "" for line in (title, *notes)]
    return head + "\n\\medskip\n".join(tabulars) + "".join(below)


_WRITERS = {"md": _markdown, "latex": _latex, "html": _html}


_TEX = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "<": "$<$", ">": "$>$", "|": "$|$", '"': "''",
    "↑": r"$\uparrow$", "↓": r"$\downarrow$", "≈": r"$\approx$", "±": r"$\pm$", "○": r"$\circ$", "·": r"$\cdot$",
    "×": r"$\times$", "°": r"$^\circ$", "µ": r"$\mu$", "Δ": r"$\Delta$", "α": r"$\alpha$", "β": r"$\beta$",
    "γ": r"$\gamma$", "ψ": r"$\psi$", **{sign: "\\" + sign for sign in "_%&#${}"},
}  # fmt: skip


# Below U+0180, what LaTeX's first font encoding (OT1, that of a document which asks for none) stops at.
_NOT_IN_OT1 = "«»ÐÞðþĄąĐđĘęĦħĮįĸĿŀŉŊŋŦŧŲųſ"


def _tex(text: str) -> str:
    """Escape text for LaTeX. A letter that its fonts lack loses its accent, or becomes a question mark."""

    def escaped(sign: str) -> str:
        if sign in _TEX or (ord(sign) < 0x180 and sign.isprintable() and sign not in _NOT_IN_OT1):
            return _TEX.get(sign, sign)
        plain = "".join(
            part for part in unicodedata.normalize("NFKD", sign) if not unicodedata.combining(part)
        )
        return plain if plain.isascii() and plain.isprintable() else "?"

    return "".join(escaped(sign) for sign in " ".join(text.split()))
