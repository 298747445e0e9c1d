"""The results folder: its score table, the parts that jobs write, and the restorations beside the pictures."""

from sucre_bench.results.reasons import Reason, brief, with_remedy
from sucre_bench.results.rows import (
    Row,
    Status,
    fingerprint,
    frame,
    replicated,
    restoration_rows,
    unreplicated,
)
from sucre_bench.results.table import TABLE, Part, merge, read, write_rows

__all__ = [
    "TABLE",
    "Part",
    "Reason",
    "Row",
    "Status",
    "brief",
    "fingerprint",
    "frame",
    "merge",
    "read",
    "replicated",
    "restoration_rows",
    "unreplicated",
    "with_remedy",
    "write_rows",
]
