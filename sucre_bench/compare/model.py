"""The types of a comparison: column, cell, table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from sucre_bench.arrays import Array
from sucre_bench.compare.bootstrap import Units
from sucre_bench.results.rows import COSTS

__all__ = ["NO_DIFFERENCE", "Cell", "Column", "Comparison", "Difference", "Measured"]

# A difference and the ends of its 95 % interval.
Difference = tuple[float, float, float]
NO_DIFFERENCE: Difference = (math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class Column:
    """A metric in one variant.

    better: "higher", "lower", or "none" for a number that only describes; range: of possible values; of: "image" or
    "chart", what a unit is; n_units, n_views, n_scenes: what all methods have; missing: units some method lacks.
    """

    metric: str
    variant: str
    unit: str
    better: str
    range: tuple[float, float]
    of: Literal["image", "chart"]
    n_units: int
    n_views: int
    n_scenes: int
    missing: int

    @property
    def ranked(self) -> bool:
        """Whether methods win or lose by it."""
        return self.better != "none" and self.metric not in COSTS


@dataclass(frozen=True)
class Cell:
    """A method's score.

    mean: over views; std: over units; low, high: 95 % interval of the mean; place: by the mean, 1 = best, equal means
    share it; rank: 1 + how many methods are better by more than chance; tie: not the best, but no different from it by
    more than chance; behind: the paired difference to the best, positive = worse; wins: in how many views it is the
    best, shared among equals, or with a baseline in how many it beats that one, equal ones half; effect: the paired
    difference to the best (or the baseline), in standard deviations of the views' differences, positive = better;
    holes: units that others have and it lacks; change: with a baseline, the score less that one's, paired.

    NaN stands for what there is not: an interval over one view or of infinite values, the best's effect against itself.
    Where scores are equal or have no interval, the mean alone decides the rank. A number that only describes has place
    and rank 0, and NaN for all that is told of better and worse.
    """

    mean: float
    std: float
    low: float
    high: float
    holes: int
    place: int = 0
    rank: int = 0
    tie: bool = False
    behind: Difference = NO_DIFFERENCE
    wins: float = math.nan
    effect: float = math.nan
    change: Difference = NO_DIFFERENCE


@dataclass(frozen=True)
class Measured:
    """The numbers behind one column's cells.

    methods: (M,) labels; views: (V, M) means per view, no holes; std: (M,) over units; holes: (M,) units that others
    have; independent: the same by independent unit, None where there are fewer than two views.
    """

    methods: tuple[str, ...]
    views: Array
    std: Array
    holes: Array
    independent: Units | None

    def of(self, methods: Sequence[int]) -> Measured:
        """The same of some of the methods, by their numbers."""
        return Measured(
            tuple(self.methods[m] for m in methods),
            self.views[:, methods],
            self.std[methods],
            self.holes[methods],
            None if self.independent is None else self.independent.of_methods(methods),
        )


@dataclass(frozen=True)
class Comparison:
    """One table: methods x columns; no cell where a method has nothing.

    title: the dataset, and the view or region if the table is of one; stale: methods left out because their rows come
    from older data; baseline: the method that others are compared with, or ""; notes: what is not counted, and why, a
    sentence each; measured: the numbers behind the cells, from which `against` makes differences to a baseline.
    """

    title: str
    methods: tuple[str, ...]
    columns: tuple[Column, ...]
    cells: dict[tuple[str, Column], Cell]
    stale: tuple[str, ...] = ()
    baseline: str = ""
    notes: tuple[str, ...] = ()
    measured: Mapping[Column, Measured] = field(default_factory=dict, repr=False, compare=False)
