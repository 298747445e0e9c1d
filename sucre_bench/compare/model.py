"""The types of a comparison: column, cell, table."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from sucre_bench import plugins
from sucre_bench.plugins.plugin import Knows, Plugin
from sucre_bench.results.rows import COSTS

if TYPE_CHECKING:
    from sucre_bench.compare.statistics import ColumnScores

# A difference and the ends of its 95 % interval.
Difference = tuple[float, float, float]
NO_DIFFERENCE: Difference = (math.nan, math.nan, math.nan)

# Over fewer views intervals are rough: so few scores do not show how scores are distributed. Short tables mark no ties
# there, and show the intervals only when asked.
FEWEST_VIEWS = 5

# Fewer views name no leader: they hide a method that fails in one view of ten too often. Of 8, 12, 16, 20 views none
# shows the failure in 43, 28, 19, 12 % of tables, and what is then seen is a difference by more than chance.
FEWEST_FOR_LEAD = 20

# The column that says which share of the image each method fills, beside scores of which this matters.
FILLED = "filled"

# Scores that differ by less than this share of their size are equal: images and most metrics are float32, which has
# seven figures.
EQUAL = 1e-6


def may_be_chance(difference: Difference) -> bool:
    """Return whether the interval of a difference includes 0; False without an interval. The one rule of ties."""
    _, low, high = difference
    return low <= 0 <= high


@dataclass(frozen=True)
class Column:
    """A metric in one variant.

    better: "higher", "lower", or "none" for a number that only describes; range: of possible values; of: "image" or
    "chart", what a unit is; n_units, n_views, n_scenes: what all methods have; missing: units some method lacks;
    pixels: "common" if methods fill different pixels, and the scores are on those that all of them fill; knows: what
    the score knows of the true colours; worth: how many independent views the differences are worth, less than n_views
    where neighbours are alike, 0 for a track of too few views to know.
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
    pixels: Literal["own", "common"] = "own"
    knows: Knows = "truth"
    worth: float = math.inf

    @property
    def plugin(self) -> Plugin | None:
        """The metric; None if it is not installed."""
        return plugins.get("metric", self.metric)

    @property
    def directed(self) -> bool:
        """Whether it is a score with a better and a worse, neither a cost nor a number that only describes."""
        return self.better != "none" and self.metric not in COSTS

    @property
    def ranked(self) -> bool:
        """Whether methods win or lose by it."""
        return self.directed and self.knows != "taste"

    @property
    def agreement(self) -> float:
        """In which share of pairs of methods a score that is evidence has the order of true colours, 0 to 1."""
        return (
            (1 + self.plugin.agreement[self.variant]) / 2
            if self.plugin and self.knows == "evidence"
            else math.nan
        )

    @property
    def has_few_views(self) -> bool:
        """Whether its views are too few for more than a rough interval."""
        return self.n_views < FEWEST_VIEWS


@dataclass(frozen=True)
class Cell:
    """A method's score.

    mean: over views; std: over units, see `standard_deviation`; low, high: 95 % interval of the mean; place: by the
    mean, 1 = best, equal means share it; rank: 1 + how many methods are better by more than chance; tie: not the best,
    but no different from it by more than chance; behind: the paired difference to the best, positive = worse; wins: in
    how many views it is the best, shared among equals, or with a baseline in how many it beats that one, equal ones
    half; effect: the paired difference to the best (or the baseline), in standard deviations of the views' differences,
    positive = better; holes: units that others have and it lacks; change: with a baseline, the score less that one's,
    paired.

    NaN stands for what there is not: an interval over one view or of infinite values, the best's effect against itself.
    Where scores are equal or have no interval, the mean alone decides the rank. A number that only describes has place
    and rank 0, and NaN instead of better and worse; so has the photograph beside restorers.
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
class Note:
    """Something that a comparison does not count.

    kind: a key of `words.NOTES`, which has its sentence; methods: labels it is about; columns: scores it is about, none
    if it is about restorations; n, total: number of lost units, and of all units; left: number of units that remain for
    all methods; lost: the lost replicates; unit: unit of n; reasons: how often each reason occurs, as text; option: the
    followed option; share: of the image, 0 to 1, where pixels are left out.
    """

    kind: str
    methods: tuple[str, ...]
    columns: tuple[Column, ...] = ()
    n: int = 0
    total: int = 0
    left: int = 0
    lost: int = 0
    unit: Literal["image", "chart"] = "image"
    reasons: str = ""
    option: str = ""
    share: float = 1.0


@dataclass(frozen=True)
class Verdict:
    """Which of two methods is ahead in a score, and whether this is a lead.

    difference: of the means, paired, at least 0; interval: its 95 % interval, for which all methods are judged together
    (`sucre_bench.compare.statistics`), NaN without one; wins: in how many views the leader is the best, or beats the
    baseline; effect: the difference in standard deviations of the views' differences, NaN if they do not vary;
    may_be_chance: whether the interval has 0; undone_by: the view or scene without which a lead may be chance, "" if no
    one decides.
    """

    column: Column
    leader: str
    second: str
    difference: float
    interval: tuple[float, float]
    wins: float
    effect: float
    may_be_chance: bool
    undone_by: str = ""

    @property
    def is_sure(self) -> bool:
        """Whether the interval excludes 0."""
        return math.isfinite(self.interval[0]) and not self.may_be_chance

    @property
    def is_lead(self) -> bool:
        """Whether the interval excludes 0, over as many views as show a method that fails in one of ten."""
        return self.is_sure and self.column.n_views >= FEWEST_FOR_LEAD


@dataclass(frozen=True)
class Comparison:
    """One table: methods x columns; no cell where a method has nothing.

    title: the dataset, and the view or region if the table is for one; baseline: the method that others are compared
    with, or ""; notes: the rows that are left out, and why; measured: the numbers behind the cells, from which
    `against` makes differences to a baseline; photographs: methods that return the photograph itself, which take no
    part in places, ranks and ties unless there are no others; lacks_truth: whether metrics found neither a reference
    nor a chart in the data.
    """

    title: str
    methods: tuple[str, ...]
    columns: tuple[Column, ...]
    cells: dict[tuple[str, Column], Cell]
    baseline: str = ""
    notes: tuple[Note, ...] = ()
    measured: Mapping[Column, ColumnScores] = field(default_factory=dict, repr=False, compare=False)
    photographs: tuple[str, ...] = ()
    lacks_truth: bool = False

    def of(self, column: Column) -> dict[str, Cell]:
        """Return the cells of a column by method, in the table's order."""
        return {
            name: self.cells[name, column] for name in self.methods if (name, column) in self.cells
        }

    @property
    def blind(self) -> str:
        """What a table says first in which no score shows which colours are true."""
        why = (
            "No chart and no reference"
            if self.lacks_truth
            else "No score here compares with a chart or a reference"
        )
        return f"{why}: nobody can say from these numbers which colours are true."

    @property
    def advice(self) -> str:
        """What a table says last in which no score shows which colours are true."""
        if self.lacks_truth:
            return "Look at the pictures, mark a chart (`sucre-bench charts`), or ask people (`study`)."
        return (
            "If the data have one, choose such a metric (`sucre-bench list metrics`); else look at the pictures, mark a"
            " chart (`sucre-bench charts`), or ask people (`study`)."
        )

    @property
    def restorers(self) -> tuple[str, ...]:
        """The methods that compete: all but the photograph."""
        return tuple(name for name in self.methods if name not in self.photographs)


def says_filled(metric: str, variant: str) -> bool:
    """Return whether a score is the share of the image that a method fills, in its first default variant."""
    plugin = plugins.get("metric", metric)
    return metric == FILLED or (
        plugin is not None and plugin.role == "coverage" and variant == plugin.default[0]
    )
