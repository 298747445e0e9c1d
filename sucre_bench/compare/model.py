"""The types of a comparison: column, cell, table."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

from sucre_bench import plugins
from sucre_bench.plugins.plugin import Knows, Plugin, Role
from sucre_bench.results.rows import COSTS, PREFERENCE

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

# Scores of no plugin.
_OURS = (*COSTS, FILLED, PREFERENCE)

# Scores that differ by less than this share of their size are equal: images and most metrics are float32, which has
# seven figures.
EQUAL = 1e-6


def may_be_chance(difference: Difference) -> bool:
    """Return whether the interval of a difference includes 0; False without an interval. The one rule of ties."""
    _, low, high = difference
    return low <= 0 <= high


def plugin_of(metric: str) -> Plugin | None:
    """Return the metric of this name; None if it is not installed. Nothing is imported for a score of no plugin."""
    return None if metric in _OURS else plugins.get("metric", metric)


@dataclass(frozen=True)
class Column:
    """A metric in one variant."""

    metric: str
    variant: str
    unit: str

    better: str
    """Is "higher", "lower", or "none" for a number that only describes."""

    range: tuple[float, float]
    """Of possible values."""

    of: Literal["image", "chart"]
    """What has a score."""

    # What all methods have: images or charts, views, scenes.
    n_scored: int
    n_views: int
    n_scenes: int

    pixels: Literal["own", "common"] = "own"
    """It is "common" if methods fill different pixels, and the scores are on those that all of them fill."""

    knows: Knows = "truth"
    """What the score knows of the true colours."""

    @property
    def plugin(self) -> Plugin | None:
        """The metric; None if it is not installed."""
        return plugin_of(self.metric)

    @property
    def role(self) -> Role:
        """What the metric tells; "" if it is not installed."""
        return self.plugin.role if self.plugin else ""

    @property
    def reach(self) -> float:
        """The largest difference between two scores. An interval that ends there, or beyond, says nothing."""
        return self.range[1] - self.range[0]

    @property
    def n_units(self) -> int:
        """How many independent units there are: scenes, or the views of a single scene."""
        return self.n_scenes if self.n_scenes > 1 else self.n_views

    @property
    def is_unknown(self) -> bool:
        """Whether it is the score of a metric that is not registered here."""
        return self.plugin is None and self.metric not in _OURS

    @property
    def key(self) -> str:
        """Its name in options and on the page."""
        return f"{self.metric}:{self.variant}"

    @property
    def is_share_filled(self) -> bool:
        """Whether it is the share of the image that a method fills."""
        return says_filled(self.metric, self.variant)

    @property
    def directed(self) -> bool:
        """Whether it is a score with a better and a worse, neither a cost nor a number that only describes."""
        return self.better != "none" and self.metric not in COSTS

    @property
    def sign(self) -> int:
        """What turns its scores into numbers of which the smallest is the best."""
        return -1 if self.better == "higher" else 1

    @property
    def ranked(self) -> bool:
        """Whether methods win or lose by it."""
        return self.directed and self.knows != "taste"

    @property
    def has_few_views(self) -> bool:
        """Whether its views are too few for more than a rough interval."""
        return self.n_views < FEWEST_VIEWS


@dataclass(frozen=True)
class Cell:
    """A method's score.

    NaN stands for what there is not: an interval over one view or of infinite values, the best's effect against itself.
    Where scores are equal or have no interval, the mean alone decides the rank. A number that only describes has place
    and rank 0, and NaN instead of better and worse; so has the photograph beside restorers.
    """

    mean: float
    """Over views."""

    std: float
    """Over views, see `standard_deviation`."""

    # The 95 % interval of the mean.
    low: float
    high: float

    holes: int
    """Images or charts that others have and it lacks."""

    place: int = 0
    """By the mean, 1 = best; equal means share it."""

    rank: int = 0
    """1 + how many methods are better by more than chance."""

    tie: bool = False
    """Not the best, but no different from it by more than chance."""

    behind: Difference = NO_DIFFERENCE
    """The paired difference to the best, positive = worse."""

    wins: float = math.nan
    """In how many views it is the best, shared among equals; with a baseline in how many it beats that one, equal ones
    half."""

    effect: float = math.nan
    """The paired difference to the best (or the baseline), in standard deviations of the views' differences, positive
    = better."""

    change: Difference = NO_DIFFERENCE
    """With a baseline, the score less that one's, paired."""


NoteKind = Literal["", "trained on", "common pixels", "own pixels", "faults"]

# Stands in the text of a note for the names of its metrics.
METRICS = "{metrics}"


@dataclass(frozen=True)
class Note:
    """Something that a comparison does not count, or should be known of its methods."""

    text: str
    """Its sentence, with `METRICS` for its columns. Of faults: what is wrong with the pictures of a method."""

    kind: NoteKind = ""

    method: str = ""
    """The label of the method that has faults."""

    columns: tuple[Column, ...] = ()
    """Scores it is about; none if it is about restorations."""


@dataclass(frozen=True)
class Verdict:
    """Which of two methods is ahead in a score, and whether this is a lead."""

    column: Column
    leader: str
    second: str

    difference: float
    """Of the means, paired, at least 0."""

    interval: tuple[float, float]
    """Its 95 % interval, for which all methods are judged together (`compare.statistics`); NaN without one."""

    wins: float
    """In how many views the leader is the best, or beats the baseline."""

    @property
    def may_be_chance(self) -> bool:
        """Whether the interval has 0."""
        return may_be_chance((self.difference, *self.interval))

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
    """One table: methods x columns; no cell where a method has nothing."""

    title: str
    """The dataset, and the view or region if the table is for one."""

    methods: tuple[str, ...]
    columns: tuple[Column, ...]
    cells: dict[tuple[str, Column], Cell]

    baseline: str = ""
    """The method that others are compared with; empty for none."""

    notes: tuple[Note, ...] = ()
    """The rows that are left out, and why."""

    measured: Mapping[Column, ColumnScores] = field(
        default_factory=dict, repr=False, compare=False
    )
    """The numbers behind the cells, from which `against` makes differences to a baseline."""

    photographs: tuple[str, ...] = ()
    """Methods that return the photograph itself: they have no place, rank and tie unless there are no others."""

    def with_columns(self, columns: Collection[Column]) -> Comparison:
        """Return the table with only these of its columns, in their order, and without notes on others alone."""
        left = (
            (note, tuple(column for column in note.columns if column in columns))
            for note in self.notes
        )
        return replace(
            self,
            columns=tuple(columns),
            notes=tuple(
                replace(note, columns=of) for note, of in left if of or not note.columns
            ),
        )

    def of(self, column: Column) -> dict[str, Cell]:
        """Return the cells of a column by method, in the table's order."""
        return {
            name: self.cells[name, column]
            for name in self.methods
            if (name, column) in self.cells
        }

    @property
    def restorers(self) -> tuple[str, ...]:
        """The methods that compete: all but the photograph."""
        return tuple(name for name in self.methods if name not in self.photographs)


def says_filled(metric: str, variant: str) -> bool:
    """Return whether a score is the share of the image that a method fills, in its first default variant."""
    plugin = plugin_of(metric)
    return metric == FILLED or (
        plugin is not None and plugin.role == "coverage" and variant == plugin.default[0]
    )
