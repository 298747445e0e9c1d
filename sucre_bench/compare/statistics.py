"""The statistics of one column of scores: means, 95 % intervals, differences, ranks, wins and effects.

Replicates are averaged to units, units to views, views to a score: a view counts once.

**Intervals of means.** Views of a scene share its water, and charts of a view share its light: they are not
independent repetitions. The independent units are therefore the scenes, or the views if there is one scene. A resample
draws as many units as there are, with replacement, each with everything in it. The spread between units already
contains the spread within them, so nothing is drawn within a unit (Davison and Hinkley 1997, sec. 3.8, strategy 1). All
methods of a table are drawn together, which pairs their differences.

A bootstrap of few units is too narrow. Its spread is too small by sqrt((n - 1) / n), and its tails are normal instead
of Student's. Intervals of means are widened by both, about the mean (Hesterberg 2015, sec. 5.3).

A score of a pair of views stands in the means of both views, so views are not independent. The spread between them
shows half of what a view brings to the overall mean or less. Each view then counts by its pseudo-value: how the overall
mean changes without it (jackknife of a U-statistic of degree 2, Arvesen 1969).

**Intervals of differences.** Differences of several pairs are judged at once, so each gets the same multiple of its
standard error. It is chosen so that all of their intervals hold together in 95 % of tables (max-t: Romano and Wolf
2005, sec. 4). Differences from one method, the best or a baseline, are fewer than those of all pairs, so they are
judged in steps (step-down max-t). Methods that differ by more than chance leave, and the others are judged anew by
shorter intervals.

Which method is the best is seen only in the scores. So the family of its leads is all pairs of the methods that are
left. But if the best method beats every other one by the pair's own Student's interval, it leads them all, however many
they are (Hung and Fithian 2019). To do this by chance, it must beat a method that is as good as itself.

**Neighbours.** Views along a track show much the same, so their differences are alike and count for fewer independent
ones. The correlation of differences between neighbours is estimated, and intervals grow as for a series with that
correlation (`Units.dependence`). Fewer than five views do not show it: then no interval ends. Views without poses have
no order, and scenes are independent.

**Rare failures.** No interval or rank test sees a failure that did not happen in the views: with eight views, one in
ten stays unseen in 43 % of tables, and all eight differences have one sign. A lead therefore also needs
`FEWEST_FOR_LEAD` views (`model.Verdict.is_lead`).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array
from sucre_bench.compare.model import (
    EQUAL,
    FEWEST_VIEWS,
    NO_DIFFERENCE,
    Cell,
    Column,
    Difference,
    may_be_chance,
)

# With 5000 resamples, half an interval differs between seeds by 2 %, with 2000 by 3 %: enough for its two figures.
_RESAMPLES = 5000
_FEWEST = 2000
_DRAWS = 10_000_000  # more than these only for the fewest resamples
_AT_ONCE = 500_000  # units, or pairs of methods, in resamples at a time
_LEVEL = 0.95
_EXACT = 1e-12  # relative spread that is rounding only
# degrees of freedom of neighbours: with fewer, no lead is found however large it is
_LEAST_FREEDOM = 3.0
_MOST_ALIKE = 0.8  # correlation of neighbours: a larger one cannot be told from a trend, and would hide any lead
# Standard errors that are added to the estimated correlation: with 0, two methods on tracks have false leads in 7 to
# 16 % of tables, with 0.85 in at most 7 %; with 1, 20 views find fewer than 95 % of leads (benchmarks/leads.py).
_CAUTION = 0.85

Pair = tuple[int, int]


@dataclass(frozen=True)
class Units:
    """A column of scores by independent unit."""

    sums: Array
    """(S, M): the sum over a unit's views, a column a method; NaN for a method with a score that is not finite."""

    sizes: Array
    """(S,): how many views a unit has."""

    in_order: bool = False
    """Whether units are views along a track, where neighbours are alike."""

    @classmethod
    def of(cls, views: Array, scenes: Sequence[int], in_order: bool = False) -> Units:
        """views: (V, M), those of a scene together; scenes: how many views each scene has; in_order: within a scene."""
        sizes = np.asarray(scenes if len(scenes) > 1 else np.ones(len(views)), dtype=np.float64)
        views = np.where(np.isfinite(views).all(axis=0), views, np.nan)
        starts = np.cumsum([0, *sizes[:-1]]).astype(int)
        return cls(np.add.reduceat(views, starts, axis=0), sizes, in_order and len(scenes) == 1)

    @functools.cached_property
    def alike(self) -> float:
        """The correlation between neighbours of the methods' differences, 0 to 0.8; 0 for units without order.

        It is of all methods together: of many pairs, one would seem independent by chance. The estimate from few views
        is too small on average, and (n r + 1) / (n - 4) is not (Marriott and Pope 1954). It has the standard error
        n / (n - 4) sqrt((1 - r^2) / n) of one series (Bartlett 1946), and M methods have M - 1 series of differences.
        `_CAUTION` such errors are added.
        """
        n = len(self.sizes)
        known = self.residuals[:, np.isfinite(self.residuals).all(axis=0)]
        if not self.in_order or n < FEWEST_VIEWS or known.shape[1] < 2:
            return 0.0
        known = known - known.mean(axis=1, keepdims=True)
        squares = float((known**2).sum())
        if squares == 0:
            return 0.0
        r = (n * float((known[1:] * known[:-1]).sum()) / squares + 1) / (n - 4)
        error = n / (n - 4) * math.sqrt(max(1 - r**2, 0) / n / (known.shape[1] - 1))
        return min(max(r + _CAUTION * error, 0.0), _MOST_ALIKE)

    @property
    def is_short_track(self) -> bool:
        """Whether views along a track are too few to show how alike neighbours are."""
        return self.in_order and len(self.sizes) < FEWEST_VIEWS

    def dependence(self) -> tuple[float, float]:
        """Return how much the squared error of a difference grows beyond that of equal independent units, and how many
        degrees of freedom the new error has.

        Views in order, five or more: the variance of a mean is f times that of independent views, for a series in
        which neighbours have the correlation r. The sample variance is too small by (n - f) / (n - 1), and n / f views
        are worth as much as n. Units of unequal size: the moments of the error if views vary alike (Satterthwaite 1946;
        Bell and McCaffrey 2002).
        """
        n = len(self.sizes)
        sizes = self.sizes
        r = self.alike
        if r > 0:
            f = n / self.worth
            return f * (n - 1) / (n - f), max((n - 1) / f, _LEAST_FREEDOM)
        if np.ptp(sizes) == 0:
            return 1.0, n - 1.0
        # residuals of independent views
        made_of = sizes[:, None] * (np.eye(n) - sizes / sizes.sum()) / np.sqrt(sizes)
        moments = made_of.T @ made_of
        expected, squared = float(np.trace(moments)), float((moments**2).sum())
        return float(sizes.sum()) * (n - 1) / n / expected, expected**2 / squared

    @property
    def worth(self) -> float:
        """How many independent units the differences between methods are worth: the variance of a mean is theirs.

        0 for a track of too few views.
        """
        n = len(self.sizes)
        if self.is_short_track:
            return 0.0
        r = self.alike
        return n / ((1 + r) / (1 - r) - 2 * r * (1 - r**n) / (n * (1 - r) ** 2))

    @functools.cached_property
    def residuals(self) -> Array:
        """(S, M): a unit's sum, less what the mean over all views gives for a unit of its size."""
        mean = self.sums.sum(axis=0) / self.sizes.sum()
        return np.asarray(self.sums - mean * self.sizes[:, None])


@dataclass(frozen=True)
class ColumnScores:
    """The numbers behind one column's cells."""

    methods: tuple[str, ...]
    """(M,): labels."""

    places: tuple[tuple[str, str], ...]
    """(V,): scene and view."""

    views: Array
    """(V, M): means per view, no holes."""

    independent: Units | None
    """The scores by independent unit; None where there are no intervals."""

    def of(self, methods: Sequence[int]) -> ColumnScores:
        """Return the scores of some methods, by their numbers."""
        units = self.independent and replace(
            self.independent, sums=self.independent.sums[:, methods]
        )
        return replace(
            self,
            methods=tuple(self.methods[m] for m in methods),
            views=self.views[:, methods],
            independent=units,
        )


def pseudo_values(views: Array) -> Array:
    """Return the jackknife's pseudo-values (V, M) of views whose scores (V, M) are means over pairs of them; V > 2.

    They have the mean of the scores. Exact if every view is paired with every other; too wide, by sqrt(2) at most, if
    a view is paired with few.
    """
    n, mean = len(views), views.mean(axis=0)
    return np.asarray(mean + 2 * (n - 1) / (n - 2) * (views - mean))


def mean_intervals(units: Units) -> tuple[Array, Array]:
    """Return the ends (M,) of the 95 % interval of each method's mean over views; NaN where scores are not finite.

    There must be at least two units.
    """
    from scipy.special import ndtri, stdtrit  # quantiles of the normal law and of Student's

    n = len(units.sizes)
    tails = (1 - _LEVEL) / 2
    counts = _resamples(n).astype(np.float64)
    deviations = counts @ units.residuals / (counts @ units.sizes[:, None])
    widening = stdtrit(n - 1, 1 - tails) / ndtri(1 - tails) * np.sqrt(n / (n - 1))
    low, high = np.quantile(deviations, [tails, 1 - tails], axis=0)
    mean = units.sums.sum(axis=0) / units.sizes.sum()
    return mean + widening * low, mean + widening * high


def differences(units: Units, pairs: Sequence[Pair]) -> Array:
    """Return half the length of the 95 % interval of each pair's difference of means (P,), valid for all pairs at once.

    A length is a multiple of a standard error (Cochran 1977, sec. 6.4: a ratio's error). For one pair, the multiple is
    Student's. For several, it is the quantile of the greatest t over the pairs in resamples, but no more than what
    Student's law and Sidak's inequality allow, whatever the correlation. With few units, resamples that drew a unit
    repeatedly have errors near 0. Then the quantile would be far too great. Too few views of a track show no
    difference: their intervals are infinite.

    pairs: numbers of methods (i, j); NaN for pairs with scores that are not finite, which do not count. There must be
    at least two units.
    """
    from scipy.special import stdtrit

    i, j = np.transpose(pairs)
    n = len(units.sizes)
    spread = units.residuals[:, i] - units.residuals[:, j]
    errors = np.sqrt((spread**2).sum(axis=0) * n / (n - 1)) / units.sizes.sum()
    if units.is_short_track:
        return np.where(np.isfinite(errors), np.inf, np.nan)
    varying = errors > _EXACT * np.nanmax(np.abs(units.sums), initial=0)
    count = int(varying.sum())
    if count == 0:
        return np.asarray(errors * 0.0)
    factor, freedom = units.dependence()
    errors *= np.sqrt(factor)
    single, most = (float(stdtrit(freedom, (1 + _LEVEL ** (1 / k)) / 2)) for k in (1, count))
    if count == 1:
        return np.asarray(errors * single)
    greatest = np.quantile(_greatest_t(units, i[varying], j[varying]), _LEVEL, method="higher")
    return np.asarray(
        errors * np.clip(greatest * single / stdtrit(n - 1, (1 + _LEVEL) / 2), single, most)
    )


def _greatest_t(units: Units, i: npt.NDArray[Any], j: npt.NDArray[Any]) -> Array:
    """The greatest |t| over the pairs of methods i and j (P,), in each resample (R,).

    With r a unit's residual, s its size, c how often it is drawn, and N = sum c s: the deviation of the mean is
    d = sum c r / N, its squared standard error n / (n - 1) sum c (r - d s)^2 / N^2.
    """
    r = units.residuals
    s = units.sizes
    n = len(s)
    counts = _resamples(n)[:_FEWEST].astype(np.float64)
    views = counts @ s[:, None]
    squared_sizes = counts @ s[:, None] ** 2
    deviation = counts @ r / views
    mixed = counts @ (r * s[:, None])
    greatest = np.zeros(len(counts))
    step = max(1, _AT_ONCE // len(counts))
    for start in range(0, len(i), step):
        a = i[start : start + step]
        b = j[start : start + step]
        d = deviation[:, a] - deviation[:, b]
        m = mixed[:, a] - mixed[:, b]
        squares = counts @ (r[:, a] - r[:, b]) ** 2 - 2 * d * m + d**2 * squared_sizes
        error = np.sqrt(np.maximum(squares, 0) * n / (n - 1)) / views
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.abs(d) / error
        # the same unit drawn n times has no spread
        t[error <= _EXACT * np.abs(d)] = np.inf
        t[d == 0] = 0
        greatest = np.maximum(greatest, t.max(axis=1))
    return greatest


@functools.lru_cache(maxsize=2)
def _resamples(n: int) -> npt.NDArray[np.uint8]:
    """How often each of n units is drawn, a line a resample: always the same, for all columns of as many units."""
    rng = np.random.default_rng(0)
    resamples = min(_RESAMPLES, max(_FEWEST, _DRAWS // n))
    draws = np.empty((resamples, n), dtype=np.uint8)
    step = max(1, _AT_ONCE // n)
    for start in range(0, resamples, step):
        lines = draws[start : start + step]
        drawn = rng.integers(n, size=lines.shape) + n * np.arange(len(lines))[:, None]
        lines[:] = np.bincount(drawn.ravel(), minlength=lines.size).reshape(lines.shape)
    return draws


def leads(units: Units, best: int) -> Array:
    """Return half the length of the interval of the best method's lead over each other one (M,).

    In at most 5 % of tables, any of these intervals excludes 0 for a method that is as good as the best. best: the
    number of the method with the best mean; NaN for it, and for pairs with scores that are not finite. There must be
    at least two units.
    """
    rivals, gaps = _rivals(units, best)
    half = np.full(len(gaps), np.nan)
    # Student's, each by itself
    half[rivals] = [differences(units, [(best, m)])[0] for m in rivals]
    if all(gaps[m] > half[m] or gaps[m] == half[m] == 0 for m in rivals):
        return half
    return _in_steps(units, best, lambda left: list(combinations([best, *left], 2)))


def changes(units: Units, baseline: int) -> Array:
    """Return half the length of the interval of each other method's difference from a baseline (M,).

    In at most 5 % of tables, any of these intervals excludes 0 for a method that does not differ from the baseline.
    baseline: its number; NaN as in `leads`. There must be at least two units.
    """
    return _in_steps(units, baseline, lambda left: [(baseline, m) for m in left])


def _in_steps(units: Units, reference: int, family: Callable[[list[int]], list[Pair]]) -> Array:
    """Judge differences from a method, then judge anew those that may be chance, until all of these stay.

    family: the pairs that are judged together while some methods are left, those of the reference first.
    """
    left, gaps = _rivals(units, reference)
    half = np.full(len(gaps), np.nan)
    while left:
        half[left] = differences(units, family(left))[: len(left)]
        behind = [m for m in left if gaps[m] <= half[m]]
        left = behind if len(behind) < len(left) else []
    return half


def _rivals(units: Units, reference: int) -> tuple[list[int], Array]:
    """The methods with an interval of their difference from a method, by number; and these differences' sizes (M,)."""
    gaps = np.abs((units.sums - units.sums[:, [reference]]).sum(axis=0)) / units.sizes.sum()
    return [m for m in np.flatnonzero(np.isfinite(gaps)).tolist() if m != reference], gaps


# -- the cells of a column ---------------------------------------------------------------------------------


def means(views: Array) -> Array:
    """Return means (M,) of (V, M), each summed without rounding: no order of views changes it."""
    finite = np.asarray(np.isfinite(views).all(axis=0))
    columns = zip(views.T, finite, strict=True)
    return np.array([math.fsum(of) / len(of) if ok else of.mean() for of, ok in columns])


def standard_deviation(values: Array) -> Array:
    """Return the sample standard deviation over the first axis, with n - 1: the images are a sample of all images.

    values: (N, ...). NaN for fewer than two values, and where one is infinite. The SUCRe paper does not say which
    definition its tables have.
    """
    if len(values) < 2:
        return np.full(values.shape[1:], np.nan)
    with np.errstate(invalid="ignore"):  # infinity minus infinity
        return np.asarray(values.std(axis=0, ddof=1))


def cells(
    column: Column, scores: ColumnScores, holes: Array, apart: Collection[str] = ()
) -> list[Cell]:
    """Return the cell of each method, compared with the best.

    holes: (M,) images or charts that others have; apart: methods that are not compared, unless all are: their cells
    have no place.
    """
    size, mean = _size(scores.views), means(scores.views)
    low = high = np.full_like(mean, np.nan)
    if scores.independent is not None:
        # within the range of the metric: with few views intervals would leave it
        low, high = np.clip(mean_intervals(scores.independent), *column.range)
    mean, low, high = (_less(each, 0.0, size) for each in (mean, low, high))
    std = standard_deviation(scores.views)
    numbers = (each.tolist() for each in (mean, std, low, high, holes))
    made = [Cell(*of_method) for of_method in zip(*numbers, strict=True)]
    if column.better == "none" or column.knows == "taste":
        return made
    every = range(len(made))
    rivals = [m for m in every if scores.methods[m] not in apart] or [*every]
    ranked = _ranked(column, scores.of(rivals), [made[m] for m in rivals])
    for m, cell in zip(rivals, ranked, strict=True):
        made[m] = cell
    return made


def _ranked(column: Column, scores: ColumnScores, made: Sequence[Cell]) -> list[Cell]:
    """Compare all methods with the best, by its leads; for ranks below it compare all pairs [i, j]."""
    worse = scores.views * column.sign
    mean, size = means(worse), _size(worse)
    sizes = np.maximum(size, size[:, None])
    gap = _less(mean, mean[:, None], sizes)  # how far j is behind i
    half = np.full_like(sizes, np.nan)  # of the interval
    places = 1 + (gap > 0).sum(axis=0)
    best = int(np.argmin(places))
    if scores.independent is not None:
        if pairs := list(combinations(range(len(made)), 2)):
            i, j = np.transpose(pairs)
            half[i, j] = half[j, i] = differences(scores.independent, pairs)
        half[best] = half[:, best] = leads(scores.independent, best)
        half[best, best] = 0.0 if np.isfinite(mean[best]) else np.nan
    may_be_equal = (_less(gap, half, sizes) <= 0) & (_less(gap, -half, sizes) >= 0)
    ranks = 1 + ((gap > 0) & ~may_be_equal).sum(axis=0)  # by the mean where chance is not known
    of_best = np.maximum(size, size[worse.argmin(axis=1)][:, None])
    # equal methods share a view
    is_best = _less(worse, worse.min(axis=1, keepdims=True), of_best) == 0
    wins = (is_best / is_best.sum(axis=1, keepdims=True)).sum(axis=0)
    numbers = (each.tolist() for each in (places, ranks if column.ranked else places, wins))
    found = zip(made, *numbers, _behind(worse, best, half[best]), strict=True)
    return [
        replace(
            cell,
            place=place,
            rank=rank,
            tie=column.ranked and place > 1 and may_be_chance(behind),
            behind=behind,
            wins=won,
            effect=_effect(lead),
        )
        for cell, place, rank, won, (behind, lead) in found
    ]


def against(
    column: Column,
    scores: ColumnScores,
    cells: Sequence[Cell],
    baseline: int,
    apart: Collection[str] = (),
) -> list[Cell]:
    """Return the cells with change, wins and effect against the baseline, the method of that number in `scores`.

    The methods of `scores` are judged together, as in `cells`; each of those apart is judged alone, unless all are.
    """
    if column.better == "none":
        return list(cells)
    half = np.full(len(cells), np.nan)
    alone = [m for m, name in enumerate(scores.methods) if name in apart and m != baseline]
    if len(alone) == len(cells) - 1:  # as in `cells`
        alone = []
    together = [m for m in range(len(cells)) if m not in alone]
    for family in (together, *([baseline, m] for m in alone)):
        units = scores.of(family).independent
        if units is not None and len(family) > 1:
            half[family] = changes(units, family.index(baseline))
    made = []
    behinds = _behind(scores.views * column.sign, baseline, half)
    for cell, (change, lead) in zip(cells, behinds, strict=True):
        if column.better == "higher":
            gap, low, high = change
            change = (0 - gap, 0 - high, 0 - low)
        change = tuple(np.clip(change, -column.reach, column.reach).tolist())
        wins = float((lead > 0).sum() + 0.5 * (lead == 0).sum())
        made.append(replace(cell, change=change, wins=wins, effect=_effect(lead)))
    made[baseline] = replace(
        cells[baseline], change=NO_DIFFERENCE, wins=math.nan, effect=math.nan
    )
    return made


def _behind(worse: Array, reference: int, half: Array) -> Iterator[tuple[Difference, Array]]:
    """For each method, how far it is behind the reference with the interval, and its lead in each view (V,).

    worse: (V, M), the smallest is the best; half: (M,) of the intervals.
    """
    mean, size = means(worse), _size(worse)
    size = np.maximum(size, size[reference])
    gap = _less(mean, mean[reference], size)
    lead = _less(worse[:, [reference]], worse, size)
    low, high = _less(gap, half, size), _less(gap, -half, size)
    intervals = zip(gap.tolist(), low.tolist(), high.tolist(), strict=True)
    return zip(intervals, lead.T, strict=True)


def _size(views: Array) -> Array:
    """(M,) how large a method's scores are, their mean without signs; 0 if one is not finite. views: (V, M)."""
    size = np.abs(views).mean(axis=0)
    return np.where(np.isfinite(size), size, 0.0)


def _less(values: Array, others: Array | float, size: Array) -> Array:
    """Differences of scores of a size; 0 between equals, be they infinite, and for what is nothing beside the size."""
    with np.errstate(invalid="ignore"):  # infinity minus infinity
        difference = values - others
    return np.where((values == others) | (np.abs(difference) <= EQUAL * size), 0.0, difference)


def _effect(lead: Array) -> float:
    """The mean lead over a reference, in standard deviations of the lead. lead: (V,); positive = better."""
    if len(lead) < 2 or not np.isfinite(lead).all():
        return math.nan
    spread = float(standard_deviation(lead))
    return float(lead.mean() / spread) if spread > EQUAL * np.abs(lead).mean() else math.nan
