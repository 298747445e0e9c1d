"""What a method told of a restoration: the file <view>.json beside the picture, read back for figures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sucre_bench import layout
from sucre_bench.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["restorations", "told"]


def restorations(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each restoration that rows tell of and that ended well: the row of its seconds."""
    return rows[(rows["metric"] == "seconds") & (rows["status"] == "ok") & (rows["view"] != "")]


def told(row: Any, out: Path) -> dict[str, Any]:
    """Return what is kept of the restoration a row is of (as `DataFrame.itertuples` gives rows); empty when nothing is.

    Raises InputError where the file is damaged.
    """
    place = layout.find(row.dataset, row.scene, row.view, out)
    path = place.restored(out, row.method).with_suffix(".json") if place else None
    if path is None or not path.is_file():
        return {}
    try:
        content: dict[str, Any] = json.loads(path.read_bytes())
    except ValueError as fault:
        raise InputError(f"{path}: cannot be read ({fault}); delete it and run again") from fault
    return content
