"""Finds the rows that were computed from the newest data."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd


def is_fresh(rows: pd.DataFrame) -> pd.Series:
    """Return which rows come from the newest data of their scene."""
    import pandas as pd

    data = rows[["dataset", "scene", "data_id"]].drop_duplicates()
    if not data.duplicated(["dataset", "scene"]).any():  # as in most folders: no scene has older data too
        return pd.Series(data=True, index=rows.index)
    newest = rows.groupby(["dataset", "scene", "data_id"])["time"].transform("max")
    return newest == newest.groupby([rows["dataset"], rows["scene"]]).transform("max")
