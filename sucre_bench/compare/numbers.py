"""One standard deviation, and one rule of rounding, for the terminal, documents, figures and the page."""

import math
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array


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


def standard_deviation(values: Array) -> Array:
    """Return the sample standard deviation over the first axis, with n - 1: the images are a sample of all images.

    values: (N, ...). NaN for fewer than two values, and where one is infinite. The SUCRe paper does not say which
    definition its tables have.
    """
    if len(values) < 2:
        return np.full(values.shape[1:], np.nan)
    with np.errstate(invalid="ignore"):  # infinity minus infinity
        return np.asarray(values.std(axis=0, ddof=1))
