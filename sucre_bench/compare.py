"""From the long table to an answer: which method is better, by how much, and whether that is more than chance.

A score's unit is an image, or a chart where the metric scores charts. Methods are compared on the units that all of
them have (a method without any restricts nobody). Intervals are 95 % bootstrap percentiles over views, since charts
of one view share its water and light; two methods tie when the interval of their paired difference holds 0.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sucre_bench import results
from sucre_bench.errors import InputError, did_you_mean

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["ARROW", "COSTS", "Cell", "Column", "Comparison", "Format", "compare", "load", "render", "verdicts"]

Format = Literal["terminal", "md", "latex", "csv", "json"]
By = Literal["method", "view", "region"]

# What a restoration takes: shown with the scores, but nobody wins by it.
COSTS = ("seconds", "peak_mb")

_RESAMPLES = 2000
_UNIT = ["scene", "view", "region"]
ARROW = {"higher": "↑", "lower": "↓"}


@dataclass(frozen=True)
class Column:
    """A metric in one variant. n_units, n_views: what all methods have; missing: units some method lacks."""

    metric: str
    variant: str
    unit: str
    better: str
    n_units: int
    n_views: int
    missing: int


@dataclass(frozen=True)
class Cell:
    """A method's score: mean, standard deviation over units, 95 % interval of the mean, rank (1 = best).

    tie: not the best, but no different from it by more than chance; behind: how far behind the best, with interval.
    """

    mean: float
    std: float
    low: float
    high: float
    rank: int
    tie: bool
    behind: tuple[float, float, float]


@dataclass(frozen=True)
class Comparison:
    """One dataset's table: rows (methods, or methods by view or region) x columns; a missing cell is a hole."""

    dataset: str
    rows: tuple[str, ...]
    columns: tuple[Column, ...]
    cells: dict[tuple[str, Column], Cell]


def load(folders: Iterable[str | Path]) -> pd.DataFrame:
    """Read the tables of several output folders as one.

    Raises InputError when a folder has none, or when two folders give one method label to different configurations.
    """
    import pandas as pd

    folders = [Path(f) for f in folders]
    rows = pd.concat([results.read(f).assign(_folder=str(f)) for f in folders], ignore_index=True)
    several = rows.groupby(["dataset", "method"])["options_id"].nunique()
    if len(folders) > 1 and (several > 1).any():
        dataset, method = several[several > 1].index[0]
        raise InputError(
            f"{method} on {dataset}: these folders mean different options by it; run one again with method.label=..."
        )
    data = rows[rows["data_id"] != ""].groupby(["dataset", "scene"])["data_id"].nunique()
    if (data > 1).any():
        dataset, scene = data[data > 1].index[0]
        raise InputError(f"{dataset} / {scene}: the data differ between these runs; run them on the same data")
    return rows.drop(columns="_folder").drop_duplicates(
        ["dataset", "scene", "view", "method", "metric", "variant", "region"], keep="last", ignore_index=True
    )


def compare(
    rows: pd.DataFrame, metrics: Sequence[str] = (), by: By = "method", order: Sequence[str] = (), seed: int = 0
) -> list[Comparison]:
    """Return a table per dataset.

    metrics: "name" or "name:variant", default all; by: what a row is ("view" and "region" split every method by it);
    order: of the methods, default as they were first run. InputError for a metric the rows do not have.
    """
    rows = _chosen(rows, metrics)
    order = [*order, *rows.sort_values("time", kind="stable")["method"].drop_duplicates()]
    return [
        _table(str(dataset), group, by, list(dict.fromkeys(order)), np.random.default_rng(seed))
        for dataset, group in rows.groupby("dataset", sort=False)
    ]


def _chosen(rows: pd.DataFrame, metrics: Sequence[str]) -> pd.DataFrame:
    rows = rows[~rows["region"].str.contains("/", regex=False)]  # patches are inside their charts' scores
    if not metrics:
        return rows
    names = {*rows["metric"], *(rows["metric"] + ":" + rows["variant"])}
    for name in metrics:
        if name not in names:
            raise InputError(f"no scores of '{name}'; {did_you_mean(name, set(rows['metric']))}")
    return rows[rows["metric"].isin(metrics) | (rows["metric"] + ":" + rows["variant"]).isin(metrics)]


def _table(dataset: str, rows: pd.DataFrame, by: By, order: list[str], rng: np.random.Generator) -> Comparison:
    label = rows["method"] if by == "method" else rows["method"] + " · " + rows[by]
    rows = rows.assign(_row=label)
    names = sorted(set(label), key=lambda n: (order.index(n.split(" · ")[0]), n))
    columns, cells = [], {}
    for (metric, variant), scores in rows.groupby(["metric", "variant"], sort=False):
        scores = scores[(scores["status"] == "ok") & scores["value"].notna()]
        if scores.empty:
            continue
        values = scores.pivot_table(index=_UNIT, columns="_row", values="value", aggfunc="first")
        everywhere = values.dropna() if by == "method" else values
        first = scores.iloc[0]
        views = everywhere.reset_index()[["scene", "view"]].drop_duplicates()
        missing = len(values) - len(everywhere)
        column = Column(str(metric), str(variant), first["unit"], first["better"], len(everywhere), len(views), missing)
        columns.append(column)
        cells.update({(name, column): cell for name, cell in _cells(everywhere, column, rng).items()})
    return Comparison(dataset, tuple(names), tuple(_metric_order(columns)), cells)


def _metric_order(columns: list[Column]) -> list[Column]:
    """Scores as they were run, what a restoration costs last."""
    return sorted(columns, key=lambda c: c.metric in COSTS)


def _cells(values: pd.DataFrame, column: Column, rng: np.random.Generator) -> dict[str, Cell]:
    """Cells of one column. values: units x rows of the table."""
    if values.empty:
        return {}
    by_view = values.groupby(level=["scene", "view"]).mean()  # (V, M)
    with warnings.catch_warnings(), np.errstate(invalid="ignore"):
        warnings.simplefilter("ignore", RuntimeWarning)  # a row of the table may have no unit in common with another
        picks = rng.integers(0, len(by_view), (_RESAMPLES, len(by_view)))
        means = np.nanmean(by_view.to_numpy()[picks], axis=1)  # (R, M)
        mean = values.mean().to_numpy()
        sign = 1 if column.better == "lower" else -1
        best = int(np.nanargmin(sign * mean))
        behind = sign * (mean - mean[best])
        worse = sign * (means - means[:, [best]])
        worse_low, worse_high = np.nanpercentile(worse, [2.5, 97.5], axis=0)
        low, high = np.nanpercentile(means, [2.5, 97.5], axis=0)
    cells = {}
    for m, name in enumerate(values.columns):
        if np.isnan(mean[m]):
            continue
        several = len(by_view) > 1
        cells[str(name)] = Cell(
            mean=float(mean[m]),
            std=float(values[name].std(ddof=0)) if np.isfinite(mean[m]) else 0.0,
            low=float(low[m]) if several else np.nan,
            high=float(high[m]) if several else np.nan,
            rank=int((sign * mean < sign * mean[m] - 1e-12).sum()) + 1,
            tie=bool(several and sign * mean[m] > sign * mean[best] + 1e-12 and worse_low[m] <= 0),
            behind=(float(behind[m]), float(worse_low[m]), float(worse_high[m])),
        )
    return cells


# -- showing it --------------------------------------------------------------------------------------------


def title(column: Column) -> str:
    """A metric's name with its variant, unit and direction."""
    unit = f" {column.unit}" if column.unit else ""
    return f"{column.metric} {ARROW[column.better]}{unit}"


def number(value: float) -> str:
    """A value with about three figures."""
    if not np.isfinite(value):
        return "inf" if value > 0 else "-inf"
    size = abs(value)
    return (
        f"{value:.0f}"
        if size >= 100
        else f"{value:.1f}"
        if size >= 10
        else f"{value:.2f}"
        if size >= 1
        else f"{value:.3f}"
    )


def verdicts(comparison: Comparison) -> list[str]:
    """Say for each score which method is best and by how much it leads the next."""
    said = []
    for column in comparison.columns:
        ranked = sorted((cell.rank, name) for name in comparison.rows if (cell := comparison.cells.get((name, column))))
        if len(ranked) < 2 or column.metric in COSTS:
            continue
        best, second = ranked[0][1], ranked[1][1]
        lead = comparison.cells[second, column]
        if lead.rank == 1:
            continue  # nobody leads
        gap = f"{number(lead.behind[0])}{' ' + column.unit if column.unit else ''}"
        spread = f" [{number(lead.behind[1])}, {number(lead.behind[2])}]" if column.n_views > 1 else ""
        tie = ", which may be chance" if lead.tie else "" if column.n_views > 1 else ", on one view"
        said.append(f"{column.metric}: {best} leads {second} by {gap}{spread}{tie}")
    return said


def render(comparison: Comparison, how: Format = "terminal", width: int = 100) -> Any:
    """Return the table: a rich renderable for the terminal, else text."""
    if how == "terminal":
        return _terminal(comparison, width)
    flat = _flat(comparison)
    if how == "csv":
        return flat.to_csv(index=False)
    if how == "json":
        return flat.to_json(orient="records", indent=1)
    return _markdown(comparison) if how == "md" else _latex(comparison)


def _flat(comparison: Comparison) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame(
        [
            {
                "dataset": comparison.dataset, "row": name, "metric": c.metric, "variant": c.variant, "unit": c.unit,
                "better": c.better, "mean": cell.mean, "std": cell.std, "low": cell.low, "high": cell.high,
                "rank": cell.rank, "tie_with_best": cell.tie, "n_units": c.n_units, "n_views": c.n_views,
            }
            for name in comparison.rows
            for c in comparison.columns
            if (cell := comparison.cells.get((name, c)))
        ]
    )  # fmt: skip


def _terminal(comparison: Comparison, width: int) -> Any:
    """Blocks of as many columns as the terminal has room for."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    first = max(len(name) for name in ("method", *comparison.rows))
    parts: list[Any] = [Text(comparison.dataset, style="bold")]
    for columns in _blocks(comparison, width - first - 2):
        block = Table(box=None, header_style="bold", pad_edge=False, padding=(0, 2, 0, 0))
        block.add_column("method", no_wrap=True)
        for column in columns:
            block.add_column(f"{title(column)}\n[dim]{column.variant}[/dim]", justify="right", no_wrap=True)
        for name in comparison.rows:
            block.add_row(name, *(_painted(comparison.cells.get((name, c)), c) for c in columns))
        parts += [block, Text("")]
    parts.append(Text(_legend(comparison), style="dim"))
    return Group(*parts)


def _blocks(comparison: Comparison, room: int) -> list[list[Column]]:
    """The columns in groups that each fit into `room` characters."""
    blocks: list[list[Column]] = []
    left = 0
    for column in comparison.columns:
        texts = [title(column), column.variant, *(_plain(comparison.cells.get((n, column))) for n in comparison.rows)]
        needs = max(len(text) for text in texts) + 2
        if not blocks or needs > left:
            blocks.append([])
            left = room
        blocks[-1].append(column)
        left -= needs
    return blocks


def _legend(comparison: Comparison) -> str:
    units = {(c.n_units, "image" if c.n_units == c.n_views else "chart") for c in comparison.columns}
    counts = " or ".join(f"{n} {unit}{'s' if n != 1 else ''}" for n, unit in sorted(units))
    holes: dict[int, list[str]] = {}
    for column in comparison.columns:
        if column.missing:
            holes.setdefault(column.missing, []).append(column.metric)
    left_out = [f"{n} left out that some method lacks: {', '.join(names)}" for n, names in holes.items()]
    marks = "bold: best, underlined: second, ≈: ties with the best"
    return "; ".join([f"mean ± standard deviation over {counts}", marks, *left_out])


def _plain(cell: Cell | None) -> str:
    return f"{'≈ ' if cell.tie else ''}{number(cell.mean)} ± {number(cell.std)}" if cell else "-"


def _painted(cell: Cell | None, column: Column) -> str:
    style = {1: "bold green", 2: "underline"}.get(cell.rank if cell else 0)
    return f"[{style}]{_plain(cell)}[/{style}]" if style and column.metric not in COSTS else _plain(cell)


def _grid(comparison: Comparison, best: str, header: str) -> list[list[str]]:
    """Header and rows with intervals; best: how the best is set, header: how a column's title is."""
    lines = [["method", *(header.format(title(c), c.variant) for c in comparison.columns)]]
    for name in comparison.rows:
        line = [name]
        for column in comparison.columns:
            cell = comparison.cells.get((name, column))
            text = "-"
            if cell:
                interval = f" [{number(cell.low)}, {number(cell.high)}]" if np.isfinite(cell.low) else ""
                text = f"{number(cell.mean)}{interval}{' ≈' if cell.tie else ''}"
                text = best.format(text) if cell.rank == 1 and column.metric not in COSTS else text
            line.append(text)
        lines.append(line)
    return lines


def _markdown(comparison: Comparison) -> str:
    header, *rows = _grid(comparison, "**{}**", "{} ({})")
    rule = ["---", *["---:"] * len(comparison.columns)]
    escaped = [[cell.replace("|", "\\|") for cell in line] for line in [header, rule, *rows]]
    return "\n".join(f"| {' | '.join(line)} |" for line in escaped) + "\n"


def _latex(comparison: Comparison) -> str:
    header, *rows = _grid(comparison, "\\textbf{{{}}}", "{} ({})")
    lines = [" & ".join(_tex(cell) for cell in line) + r" \\" for line in [header, *rows]]
    columns = "l" + "r" * len(comparison.columns)
    body = "\n".join(lines[1:])
    return (
        f"\\begin{{tabular}}{{{columns}}}\n\\toprule\n{lines[0]}\n\\midrule\n{body}\n\\bottomrule\n\\end{{tabular}}\n"
    )


def _tex(text: str) -> str:
    signs = {"↑": r"$\uparrow$", "↓": r"$\downarrow$", "≈": r"$\approx$", "·": r"$\cdot$", "Δ": r"$\Delta$"}
    for sign in "_%&#":
        text = text.replace(sign, "\\" + sign)
    for sign, command in signs.items():
        text = text.replace(sign, command)
    return text
