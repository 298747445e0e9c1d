"""The table of published against measured numbers that `sucre-bench gallery` leaves in a results folder."""

from __future__ import annotations

import csv
from pathlib import Path

FILE = "tables/gallery-published.csv"
HEADS = ["exhibit", "row", "score", "published", "measured", "difference", "views", "form", "reason", "source"]


def read(out: Path) -> list[dict[str, str]]:
    """Return its rows, by heading; none if the folder has no such table, or one of others."""
    try:
        with (out / FILE).open(encoding="utf-8", newline="") as file:
            table = csv.DictReader(file)
            return list(table) if table.fieldnames == HEADS else []
    except (OSError, ValueError, csv.Error):
        return []
