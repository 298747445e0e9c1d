"""Rounds numbers for tables, by one rule for the terminal, documents and the page."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class NumberRule:
    """How numbers are rounded.

    decimals: (least size, decimals), largest first; figures: of smaller numbers; scientific_below: from what size on
    these are written as 1.2e-05.
    """

    decimals: tuple[tuple[float, int], ...]
    figures: int
    scientific_below: float


NUMBERS = NumberRule(((100, 0), (10, 1), (1, 2), (0.1, 3)), 2, 1e-4)


def number(value: float) -> str:
    """Return three figures, two below 0.1 (see `NUMBERS`); "-" for NaN."""
    if not math.isfinite(value):
        return "-" if math.isnan(value) else "inf" if value > 0 else "-inf"
    size = abs(value)
    for least, decimals in NUMBERS.decimals:
        if size >= least:
            return f"{value:.{decimals}f}"
    return f"{value:#.{NUMBERS.figures}g}" if size else "0"


def signed(value: float) -> str:
    """A number that says that it is a difference: "+0.31"."""
    return f"+{number(value)}" if value > 0 else number(value)
