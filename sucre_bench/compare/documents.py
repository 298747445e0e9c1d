"""A comparison for papers and programs: Markdown, LaTeX (booktabs), HTML, CSV, JSON."""

import html
import math
import re
import unicodedata
from collections.abc import Iterator, Sequence
from typing import Any, Literal

from sucre_bench.compare import Column, Comparison
from sucre_bench.compare.answer import deciding
from sucre_bench.compare.model import says_filled
from sucre_bench.compare.terminal_table import blocks
from sucre_bench.compare.words import BLIND, Shown, left_out, legend, shown, title
from sucre_bench.machine.records import json_text
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

        return csv_text(pd.DataFrame(records))
    one = {"md": _markdown, "latex": _latex, "html": _html}[how]
    return "\n".join(one(comparison, len(comparisons) > 1, spread) for comparison in comparisons)


def _records(comparison: Comparison) -> Iterator[dict[str, Any]]:
    """A record a cell. filled: the share of the image that the method fills; NaN if that is in no column."""
    filled = {n: cell.mean for (n, c), cell in comparison.cells.items() if says_filled(c.metric, c.variant)}
    for name in comparison.methods:
        for c in comparison.columns:
            cell = comparison.cells.get((name, c))
            if cell is None:
                continue
            behind, behind_low, behind_high = cell.behind
            change, change_low, change_high = cell.change
            record = {
                "table": comparison.title, "method": name, "metric": c.metric, "variant": c.variant, "unit": c.unit,
                "better": c.better, "mean": cell.mean, "std": cell.std, "low": cell.low, "high": cell.high,
                "place": cell.place, "rank": cell.rank, "tie_with_best": cell.tie,
                "behind": behind, "behind_low": behind_low, "behind_high": behind_high,
                "wins": cell.wins, "effect": cell.effect, "holes": cell.holes,
                "n_units": c.n_units, "n_views": c.n_views, "n_scenes": c.n_scenes,
                "pixels": c.pixels, "filled": filled.get(name, math.nan),
            }  # fmt: skip
            if comparison.baseline:
                record |= {"baseline": comparison.baseline, "change": change}
                record |= {"change_low": change_low, "change_high": change_high}
            yield record


def _heading(column: Column) -> str:
    return f"{title(column)} ({column.variant})"


def _cells(comparison: Comparison, name: str, spread: bool) -> list[Shown]:
    return [shown(comparison, name, column, spread) for column in comparison.columns]


def _evidence(comparison: Comparison) -> list[str]:
    """With a baseline: in how many views each method beats it, and the effect, a line a method."""
    if not comparison.baseline:
        return []
    lines = []
    for name in comparison.methods:
        ranked = [(c, cell) for c in comparison.columns if (cell := comparison.cells.get((name, c))) and c.ranked]
        parts = [
            f"{c.metric} {round(cell.wins, 1):g}/{c.n_views}"
            + (f", effect {cell.effect:.1f}" if math.isfinite(cell.effect) else "")
            for c, cell in ranked
            if math.isfinite(cell.wins)
        ]
        if parts:
            lines.append(f"{name} better than {comparison.baseline} in views: {'; '.join(parts)}")
    return lines


def _below(comparison: Comparison, spread: bool) -> list[str]:
    blind = [] if deciding(comparison, every=True).knows_colours else [BLIND]
    return [*blind, legend(comparison, spread), *_evidence(comparison), *left_out(comparison)]


# -- Markdown ----------------------------------------------------------------------------------------------


def _markdown(comparison: Comparison, titled: bool, spread: bool) -> str:
    sets = {"best": "**{}**", "better": "**{}**", "second": "<u>{}</u>"}
    lines = [["method", *map(_heading, comparison.columns)], ["---", *["---:"] * len(comparison.columns)]]
    for name in comparison.methods:
        lines.append([_md(name), *(sets.get(c.look, "{}").format(c) for c in _cells(comparison, name, spread))])
    head = f"**{_md(comparison.title)}**\n\n" if titled else ""
    table = "".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in line)} |\n" for line in lines)
    return head + table + "".join(f"\n{_md(note)}\n" for note in _below(comparison, spread))


def _md(text: str) -> str:
    """A label is no markup."""
    return re.sub(r"([*`<\\])", r"\\\1", text)


# -- LaTeX -------------------------------------------------------------------------------------------------


def _latex(comparison: Comparison, titled: bool, spread: bool) -> str:
    sets = {"best": r"\textbf{{{}}}", "better": r"\textbf{{{}}}", "second": r"\underline{{{}}}"}
    heads = [_heading(column) for column in comparison.columns]
    cells = [_cells(comparison, name, spread) for name in comparison.methods]
    rows = [
        [_first(_tex(name)), *(sets.get(c.look, "{}").format(_tex_number(str(c))) for c in row)]
        for name, row in zip(comparison.methods, cells, strict=True)
    ]
    head = [f"% {_one_line(comparison.title)}"] if titled else []
    notes = [f"% {_one_line(note)}" for note in _below(comparison, spread)]
    widths = [max(map(len, map(str, column))) for column in zip(heads, *cells, strict=True)]
    first = max(map(len, ("method", *comparison.methods)))
    lines = [["method", *map(_tex, heads)], *rows]
    beside = [*blocks(widths, _PAGE - first)] or [slice(0)]
    tabulars = [_tabular([line[:1] + line[1:][places] for line in lines]) for places in beside]
    return "\n".join([*head, "\n\n\\medskip\n".join(tabulars), *notes]) + "\n"


def _tabular(table: Sequence[Sequence[str]]) -> str:
    """A first line, and those below it."""
    header, *lines = (" & ".join(line) + r" \\" for line in table)
    begin = rf"\begin{{tabular}}{{l{'r' * (len(table[0]) - 1)}}}"
    return "\n".join([begin, r"\toprule", header, r"\midrule", *lines, r"\bottomrule", r"\end{tabular}"])


def _one_line(text: str) -> str:
    """A comment ends with its line."""
    return " ".join(text.split())


def _first(text: str) -> str:
    r"""The first cell of a line: after \\ and \midrule, brackets and stars are their options."""
    return f"{{}}{text}" if text.startswith(("[", "*", "(")) else text


def _tex_number(text: str) -> str:
    """Numbers with signs as mathematics has them."""
    return re.sub(r"[+-](?=\d|\.|inf)", r"$\g<0>$", _tex(text))


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
    return "".join(_TEX.get(sign) or _in_ot1(sign) for sign in _one_line(text))


def _in_ot1(sign: str) -> str:
    if ord(sign) < 0x180 and sign.isprintable() and sign not in _NOT_IN_OT1:
        return sign
    plain = "".join(part for part in unicodedata.normalize("NFKD", sign) if not unicodedata.combining(part))
    return plain if plain.isascii() and plain.isprintable() else "?"


# -- HTML --------------------------------------------------------------------------------------------------


def _html(comparison: Comparison, titled: bool, spread: bool) -> str:
    sets = {"best": "<strong>{}</strong>", "better": "<strong>{}</strong>", "second": "<u>{}</u>"}
    head = "".join(f'<th scope="col">{html.escape(text)}</th>' for text in map(_heading, comparison.columns))
    lines = ["<table>", f"<caption>{html.escape(comparison.title)}</caption>"] if titled else ["<table>"]
    lines += [f'<thead><tr><th scope="col">method</th>{head}</tr></thead>', "<tbody>"]
    for name in comparison.methods:
        cells = (sets.get(c.look, "{}").format(html.escape(str(c))) for c in _cells(comparison, name, spread))
        row = "".join(f"<td>{cell}</td>" for cell in cells)
        lines.append(f'<tr><th scope="row">{html.escape(name)}</th>{row}</tr>')
    notes = [f"<p>{html.escape(note)}</p>" for note in _below(comparison, spread)]
    return "\n".join([*lines, "</tbody>", "</table>", *notes]) + "\n"
