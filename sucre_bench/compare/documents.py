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
    ShownColumn,
    answer,
    deciding,
    faults,
    left_out,
    legend,
    name_in,
    notes_once,
    over_views,
    shown,
    shown_column,
    signs,
    title,
)
from sucre_bench.machine.text_formats import json_text
from sucre_bench.results.rows import csv_text

_PAGE = 108  # characters that fit beside each other on a page of two columns, about 500 points

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
        columns = [
            shown_column(one, column, f"{title(column)} ({column.variant})", spread=spread)
            for column in one.columns
        ]
        head = one.title if len(comparisons) > 1 else ""
        made.append(_WRITERS[how](head, one.methods, columns, _below(one, spread)))
    return "\n".join(made)


def levels_as_text(tables: Mapping[str, Sequence[Level]], how: Literal["md", "latex"]) -> str:
    """Return a table a score: methods are its lines, the levels of an option its columns.

    tables: the levels of each table by its title. Ranks are of a level: nobody compares methods at unlike noise.
    """
    made = []
    for title_of, levels in tables.items():
        first = levels[0].comparison
        lines = [*levels[0].lines]
        for column in first.columns:
            columns = [
                ShownColumn(
                    level.name,
                    [shown(level.comparison, level.lines[name], column) for name in lines],
                )
                for level in levels
            ]
            cells = [cell for one in columns for cell in one.cells]
            of = "mean [95 % interval]" if any(cell.interval for cell in cells) else "mean"
            below = "; ".join([of, *over_views([column]), *signs(first, cells)])
            head = f"{title_of}: {title(column)} ({column.variant})"
            made.append(_WRITERS[how](head, lines, columns, [below]))
        notes = left_out(first)
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


def _differs(cell: Cell) -> bool:
    """Whether scores differ from the baseline's: equal ones have no effect."""
    return cell.change[0] != 0 or math.isfinite(cell.effect)


def _below(comparison: Comparison, spread: bool) -> list[str]:
    """The notes below a table; with a baseline, also in how many views each method beats it, and the effect."""
    knows = deciding(comparison, every=True).knows_colours
    lines = faults(comparison) if knows else answer(comparison, deciding(comparison))
    lines.append(legend(comparison, spread))
    for name in comparison.methods if comparison.baseline else ():
        parts = [
            f"{name_in(comparison, c)} "
            + (f"{round(cell.wins, 1):g}/{c.n_views}" if _differs(cell) else "equal")
            + (f", effect {cell.effect:.1f}" if math.isfinite(cell.effect) else "")
            for c in comparison.columns
            if c.ranked
            and (cell := comparison.cells.get((name, c)))
            and math.isfinite(cell.wins)
        ]
        if parts:
            lines.append(
                f"{name} better than {comparison.baseline} in views: {'; '.join(parts)}"
            )
    return lines + left_out(comparison)


# How each format sets a cell apart.
_MARKS = {
    "md": {"best": "**{}**", "second": "<u>{}</u>"},
    "html": {"best": "<strong>{}</strong>", "second": "<u>{}</u>"},
    "latex": {"best": r"\textbf{{{}}}", "second": r"\underline{{{}}}"},
}


def _marked(
    methods: Sequence[str],
    columns: Sequence[ShownColumn],
    how: str,
    escaped: Callable[[str], str],
    number: Callable[[str], str] | None = None,
) -> DataFrame:
    """The cells of a table as a format has them, a line a method, whose name is the index.

    number: makes text of a number and its interval, as `escaped` by default.
    """
    import pandas as pd

    def marked(cell: Shown) -> str:
        look = "best" if cell.look == "better" else cell.look
        return _MARKS[how].get(look, "{}").format((number or escaped)(str(cell)))

    texts = {n: [marked(cell) for cell in column.cells] for n, column in enumerate(columns)}
    table = pd.DataFrame(texts, index=[escaped(name) for name in methods])
    heads = pd.Index([escaped(column.head) for column in columns], name="method")
    return table.set_axis(heads, axis="columns")


def _markdown(
    title: str, methods: Sequence[str], columns: Sequence[ShownColumn], notes: Sequence[str]
) -> str:
    def plain(text: str) -> str:
        # a label is no markup
        return re.sub(r"([*`\[\]\\|])", r"\\\1", html.escape(text, quote=False))

    cells = _marked(methods, columns, "md", plain, number=str)
    lines = [[cells.columns.name, *cells.columns], ["---", *["---:"] * len(cells.columns)]]
    lines += [[name, *row] for name, row in zip(cells.index, cells.to_numpy(), strict=True)]
    head = f"**{plain(title)}**\n\n" if title else ""
    table = "".join(f"| {' | '.join(line)} |\n" for line in lines)
    return head + table + "".join(f"\n{plain(note)}\n" for note in notes)


def _html(
    title: str, methods: Sequence[str], columns: Sequence[ShownColumn], notes: Sequence[str]
) -> str:
    table = _marked(methods, columns, "html", html.escape).style
    if title:
        table = table.set_caption(html.escape(title))
    below = "".join(f"<p>{html.escape(note)}</p>\n" for note in notes)
    return table.to_html(exclude_styles=True) + below


# -- LaTeX -------------------------------------------------------------------------------------------------


def _latex(
    title: str, methods: Sequence[str], columns: Sequence[ShownColumn], notes: Sequence[str]
) -> str:
    widths = [max(len(str(text)) for text in (one.head, *one.cells)) for one in columns]
    room = _PAGE - max(len(name) for name in ("method", *methods))
    cells = _marked(methods, columns, "latex", _tex)
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
        if sign in _TEX or (
            ord(sign) < 0x180 and sign.isprintable() and sign not in _NOT_IN_OT1
        ):
            return _TEX.get(sign, sign)
        plain = "".join(
            part
            for part in unicodedata.normalize("NFKD", sign)
            if not unicodedata.combining(part)
        )
        return plain if plain.isascii() and plain.isprintable() else "?"

    return "".join(escaped(sign) for sign in " ".join(text.split()))
