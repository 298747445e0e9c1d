"""Finds the rows that were computed from the newest data."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["is_fresh"]


def is_fresh(rows: pd.DataFrame) -> pd.Series:
    """Return which rows come from the newest data of their scene."""
    newest = rows.groupby(["dataset", "scene", "data_id"])["time"].transform("max")
    return newest == newest.groupby([rows["dataset"], rows["scene"]]).transform("max")
