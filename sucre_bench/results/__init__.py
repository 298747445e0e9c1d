"""The results folder: its score table, the parts that jobs write, and the restorations beside the pictures."""

from __future__ import annotations

from sucre_bench.results.rows import COLUMNS, Row, Status, fingerprint, frame, replicated, unreplicated
from sucre_bench.results.table import PARTS, TABLE, Part, merge, read

__all__ = [
    "COLUMNS",
    "PARTS",
    "TABLE",
    "Part",
    "Row",
    "Status",
    "fingerprint",
    "frame",
    "merge",
    "read",
    "replicated",
    "unreplicated",
]
