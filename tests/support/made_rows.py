"""Rows of scores that a test knows beforehand, and their comparison."""

import io
import json
from dataclasses import replace

import numpy as np
import pandas as pd
from rich.console import Console, RenderableType

from sucre_bench import compare
from sucre_bench.results.rows import Row, frame

ROW = Row(
    dataset="sea",
    scene="reef",
    view="a",
    method="m",
    metric="psnr",
    variant="masked",
    value=1.0,
    unit="dB",
    better="higher",
    data_id="d",
    time="2026-01-01",
    # without poses, views are no track
    options=json.dumps({"dataset": {"name": "photos"}}),
)


def restored(
    method: str, view: str, reason: str = "", status: str = "ok", **more: str
) -> list[Row]:
    """A restoration and its score, or why there is none."""
    row = replace(ROW, method=method, view=view, status=status, reason=reason, **more)
    row = row if status == "ok" else replace(row, value=np.nan)
    whole = replace(row, metric="seconds", variant="wall", unit="s", better="lower")
    return [whole, row] if status == "ok" else [whole]


def rows_of(scores: dict[str, list[float | None]], **kind: str) -> pd.DataFrame:
    """Rows of methods whose values by view are given; None is a failed view."""
    rows = []
    for method, values in scores.items():
        for view, value in enumerate(values):
            row = replace(ROW, method=method, view=f"v{view:03}", **kind)
            failed = replace(row, value=np.nan, status="failed", reason="boom")
            rows.append(failed if value is None else replace(row, value=value))
    return frame(rows)


def table(
    scores: dict[str, list[float | None]], baseline: str = "", **kind: str
) -> compare.Comparison:
    """The comparison of these rows, methods in the order of `scores`."""
    rows = rows_of(scores, **kind)
    (comparison,) = compare.compare(rows, order=list(scores), baseline=baseline)
    return comparison


def on_terminal(*blocks: RenderableType, width: int = 120, colours: bool = False) -> str:
    """What rich prints of them."""
    console = Console(
        file=io.StringIO(),
        width=width,
        force_terminal=colours,
        color_system="standard" if colours else None,
    )
    console.print(*blocks, sep="\n")
    return console.file.getvalue()
