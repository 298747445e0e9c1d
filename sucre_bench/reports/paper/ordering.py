"""What a study is: its name, and what is made of its rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from sucre_bench.compare import By, Column, Comparison, compare
from sucre_bench.jobs.study import Study

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["compared", "in_order"]


def compared(rows: pd.DataFrame, study: Study, by: By = "method") -> list[Comparison]:
    """Return the study's comparison of methods, a table a dataset (or a view or region of it), in the order of rows."""
    order = list(dict.fromkeys(rows["method"]))
    comparisons = compare(rows, study.metrics, by, order, study.baseline)
    return [in_order(comparison, study.metrics) for comparison in comparisons]


def in_order(comparison: Comparison, metrics: Sequence[str]) -> Comparison:
    """Return a comparison with its columns in the order in which `metrics` names them."""

    def place(column: Column) -> int:
        names = (column.metric, f"{column.metric}:{column.variant}")
        return next((n for n, metric in enumerate(metrics) if metric in names), len(metrics))

    return replace(comparison, columns=tuple(sorted(comparison.columns, key=place)))
