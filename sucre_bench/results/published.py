"""The table of published against measured numbers that `sucre-bench gallery` leaves in a results folder."""

from __future__ import annotations

import csv
from pathlib import Path

FILE = "tables/published.csv"


def read(out: Path) -> list[dict[str, str]]:
    """Return its rows, by heading; none if the folder has no such table."""
    path = out / FILE
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
