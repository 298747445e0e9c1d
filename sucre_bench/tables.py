"""A comparison as people and programs read it: terminal, Markdown, LaTeX, CSV, JSON, and a sentence a metric."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Literal

from sucre_bench.compare import COSTS, Cell, Column, Comparison

if TYPE_CHECKING:
    from rich.console import RenderableType

__all__ = ["ARROW", "Format", "as_table", "as_text", "left_out", "number", "title", "verdicts"]

Format = Literal["md", "latex", "csv", "json"]

ARROW = {"higher": "↑", "lower": "↓"}


def title(column: Column) -> str:
    """A metric's name with its direction and unit."""
    return f"{column.metric} {ARROW[column.better]} {column.unit}".rstrip()


def number(value: float) -> str:
    """Three figures, two below 0.1; "-" for NaN."""
    if not math.isfinite(value):
        return "-" if math.isnan(value) else "inf" if value > 0 else "-inf"
    size = abs(value)
    for least, text in ((100, f"{value:.0f}"), (10, f"{value:.1f}"), (1, f"{value:.2f}"), (0.1, f"{value:.3f}")):
        if size >= least:
            return text
    return f"{value:#.2g}" if size else "0"


def verdicts(comparison: Comparison) -> list[str]:
    """Say for each score which method leads the next, and by how much; nothing where nobody leads."""
    said = []
    variants = [c.metric for c in comparison.columns]
    for column in comparison.columns:
        ranked = sorted(
            (cell.rank, name) for name in comparison.methods if (cell := comparison.cells.get((name, column)))
        )
        if len(ranked) < 2 or column.metric in COSTS:
            continue
        (_, best), (rank, second) = ranked[:2]
        gap, low, high = comparison.cells[second, column].behind
        if rank == 1 or not math.isfinite(gap):
            continue
        name = column.metric if variants.count(column.metric) == 1 else f"{column.metric} ({column.variant})"
        spread = f" [{number(low)}, {number(high)}]" if math.isfinite(low) else ""
        tie = ", which may be chance" if comparison.cells[second, column].tie else "" if spread else ", on one view"
        said.append(f"{name}: {best} leads {second} by {number(gap)} {column.unit}".rstrip() + spread + tie)
    return said


# -- for the terminal --------------------------------------------------------------------------------------


def as_table(comparison: Comparison, width: int) -> RenderableType:
    """Return a rich renderable: blocks of as many columns as `width` characters have room for."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    first = max(len(name) for name in ("method", *comparison.methods))
    parts: list[Any] = [Text(comparison.title, style="bold")]
    for columns in _blocks(comparison, width - first - 2):
        block = Table(box=None, header_style="bold", pad_edge=False, padding=(0, 2, 0, 0))
        block.add_column("method", no_wrap=True)
        for column in columns:
            head = Text(f"{title(column)}\n").append(column.variant, style="dim")
            block.add_column(head, justify="right", no_wrap=True)
        for name in comparison.methods:
            block.add_row(Text(name), *(_painted(comparison.cells.get((name, c)), c) for c in columns))
        parts += [block, Text("")]
    parts.append(Text(_legend(comparison), style="dim"))
    return Group(*parts)


def _blocks(comparison: Comparison, room: int) -> Iterator[list[Column]]:
    """The columns in groups that each fit into `room` characters."""
    block: list[Column] = []
    left = room
    for column in comparison.columns:
        texts = [
            title(column),
            column.variant,
            *(_plain(comparison.cells.get((n, column))) for n in comparison.methods),
        ]
        needs = max(len(text) for text in texts) + 2
        if block and needs > left:
            yield block
            block, left = [], room
        block.append(column)
        left -= needs
    if block:
        yield block


def _legend(comparison: Comparison) -> str:
    units = {(c.n_units, c.of) for c in comparison.columns}
    counts = " or ".join(f"{n} {of}{'s' if n != 1 else ''}" for n, of in sorted(units))
    marks = "bold: best, underlined: second, ≈: ties with the best"
    return "; ".join([f"mean ± standard deviation over {counts}", marks, *left_out(comparison)])


def left_out(comparison: Comparison) -> list[str]:
    """Say what the comparison does not count, and why."""
    holes: dict[int, list[str]] = {}
    for column in comparison.columns:
        if column.missing:
            holes.setdefault(column.missing, []).append(column.metric)
    said = [f"{n} left out that some method lacks: {', '.join(dict.fromkeys(names))}" for n, names in holes.items()]
    if comparison.stale:
        said.append(f"left out, for they ran on other data: {', '.join(comparison.stale)}")
    return said


def _plain(cell: Cell | None) -> str:
    return f"{'≈ ' if cell.tie else ''}{number(cell.mean)} ± {number(cell.std)}" if cell else "-"


def _painted(cell: Cell | None, column: Column) -> Any:
    from rich.text import Text

    style = {1: "bold green", 2: "underline"}.get(cell.rank if cell else 0, "")
    return Text(_plain(cell), style="" if column.metric in COSTS else style)


# -- for papers and programs -------------------------------------------------------------------------------


def as_text(comparisons: Sequence[Comparison], how: Format) -> str:
    """Return all tables as one text: CSV and JSON a record a cell, Markdown and LaTeX a titled table each."""
    if how in ("csv", "json"):
        records = [record for comparison in comparisons for record in _records(comparison)]
        if how == "json":
            return json.dumps([{k: _null(v) for k, v in r.items()} for r in records], indent=1) + "\n"
        import pandas as pd

        return str(pd.DataFrame(records).to_csv(index=False))
    one = _markdown if how == "md" else _latex
    return "\n".join(one(comparison, titled=len(comparisons) > 1) for comparison in comparisons)


def _null(value: Any) -> Any:
    """JSON knows no NaN and no infinity."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _records(comparison: Comparison) -> Iterator[dict[str, Any]]:
    for name in comparison.methods:
        for c in comparison.columns:
            if cell := comparison.cells.get((name, c)):
                yield {
                    "table": comparison.title, "method": name, "metric": c.metric, "variant": c.variant, "unit": c.unit,
                    "better": c.better, "mean": cell.mean, "std": cell.std, "low": cell.low, "high": cell.high,
                    "rank": cell.rank, "tie_with_best": cell.tie, "n_units": c.n_units, "n_views": c.n_views,
                }  # fmt: skip


def _grid(comparison: Comparison, bold: str) -> list[list[str]]:
    """Header and rows with intervals; bold: how the best is set."""
    lines = [["method", *(f"{title(c)} ({c.variant})" for c in comparison.columns)]]
    for name in comparison.methods:
        line = [name]
        for column in comparison.columns:
            cell = comparison.cells.get((name, column))
            text = "-"
            if cell:
                interval = f" [{number(cell.low)}, {number(cell.high)}]" if math.isfinite(cell.low) else ""
                text = f"{number(cell.mean)}{interval}{' ≈' if cell.tie else ''}"
                text = bold.format(text) if cell.rank == 1 and column.metric not in COSTS else text
            line.append(text)
        lines.append(line)
    return lines


def _markdown(comparison: Comparison, titled: bool) -> str:
    header, *rows = _grid(comparison, "**{}**")
    rule = ["---", *["---:"] * len(comparison.columns)]
    escaped = [[cell.replace("|", "\\|") for cell in line] for line in [header, rule, *rows]]
    notes = "".join(f"\n{note}\n" for note in left_out(comparison))
    head = f"**{comparison.title}**\n\n" if titled else ""
    return head + "\n".join(f"| {' | '.join(line)} |" for line in escaped) + "\n" + notes


def _latex(comparison: Comparison, titled: bool) -> str:
    header, *rows = ([_tex(cell) for cell in line] for line in _grid(comparison, "\0{}\1"))
    lines = [" & ".join(line).replace("\0", r"\textbf{").replace("\1", "}") + r" \\" for line in [header, *rows]]
    columns = "l" + "r" * len(comparison.columns)
    notes = [f"% {note}" for note in left_out(comparison)]
    head = [f"% {comparison.title}"] if titled else []
    table = [rf"\begin{{tabular}}{{{columns}}}", r"\toprule", lines[0], r"\midrule", *lines[1:], r"\bottomrule"]
    return "\n".join([*head, *notes, *table, r"\end{tabular}"]) + "\n"


def _tex(text: str) -> str:
    text = text.replace("\\", r"\textbackslash ")
    for sign in "_%&#${}":
        text = text.replace(sign, "\\" + sign)
    for sign, command in {"~": "textasciitilde", "^": "textasciicircum"}.items():
        text = text.replace(sign, f"\\{command} ")
    for sign, command in {"↑": "uparrow", "↓": "downarrow", "≈": "approx", "·": "cdot", "Δ": "Delta"}.items():
        text = text.replace(sign, f"$\\{command}$")
    return text
