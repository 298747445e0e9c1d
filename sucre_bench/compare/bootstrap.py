"""95 % intervals of means, and simultaneous ones of differences, by a bootstrap over independent units.

Views of a scene share its water, and charts of a view share its light: they are not independent repetitions. The
independent units are therefore the scenes, or the views if there is one scene. A resample draws as many units as there
are, with replacement, each with everything in it. The spread between units already contains the spread within them,
so nothing is drawn within a unit (Davison and Hinkley 1997, sec. 3.8, strategy 1). All methods of a table are drawn
together, which pairs their differences.

A bootstrap of few units is too narrow: its spread is too small by sqrt((n - 1) / n), and its tails are normal instead
of Student's. Intervals of means are widened by both, about the mean (Hesterberg 2015, sec. 5.3).

A score of a pair of views stands in the means of both views, so views are not independent, and the spread between them
shows half of what a view brings to the overall mean or less. Each view then counts by its pseudo-value: how the overall
mean changes without it (jackknife of a U-statistic of degree 2, Arvesen 1969).

Differences of several pairs are judged at once, so each gets the same multiple of its standard error, chosen so that
all of their intervals hold together in 95 % of tables (max-t: Romano and Wolf 2005, sec. 4).

95 % intervals of the differences from one method: the best, or a baseline.

They are fewer than those of all pairs, so they are judged in steps (step-down max-t: Romano and Wolf 2005, sec. 4).
Methods that differ by more than chance leave, and the others are judged anew by shorter intervals.

Which method is the best is seen only in the scores, so the family of its leads is all pairs of the methods that are
left. But if the best method beats every other one by the pair's own Student's interval, it leads them all, however many
they are (Hung and Fithian 2019): to do this by chance, it must beat a method that is as good as itself.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array

# With 5000 resamples, half an interval differs between seeds by 2 %, with 2000 by 3 %: enough for its two figures.
_RESAMPLES, _FEWEST = 5000, 2000
_DRAWS = 10_000_000  # more than these only for the fewest resamples
_AT_ONCE = 500_000  # units drawn at a time
_KEPT_DRAWS = 40_000_000  # most bytes of draws that stay in memory for the next column
_LEVEL = 0.95
_EXACT = 1e-12  # relative spread that is rounding only

Pair = tuple[int, int]


@dataclass(frozen=True)
class Units:
    """A column of scores by independent unit.

    sums: (S, M) the sum over a unit's views, a column a method; sizes: (S,) how many views a unit has.
    """

    sums: Array
    sizes: Array

    @classmethod
    def of(cls, views: Array, scenes: Sequence[int]) -> Units:
        """views: (V, M), those of a scene together; scenes: how many views each scene has."""
        if len(scenes) < 2:
            return cls(views, np.ones(len(views)))
        ends = np.cumsum([0, *scenes])
        return cls(np.stack([views[a:b].sum(axis=0) for a, b in pairwise(ends)]), np.asarray(scenes, dtype=np.float64))

    def of_methods(self, methods: Sequence[int]) -> Units:
        """The same of some of the methods, by their numbers."""
        return Units(self.sums[:, methods], self.sizes)

    @property
    def residuals(self) -> Array:
        """(S, M): a unit's sum, less what the mean over all views gives for a unit of its size."""
        mean = self.sums.sum(axis=0) / self.sizes.sum()
        return np.asarray(self.sums - mean * self.sizes[:, None])


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

    n, finite = len(units.sizes), np.isfinite(units.sums).all(axis=0)
    residuals = np.where(finite, Units(np.where(finite, units.sums, 0.0), units.sizes).residuals, np.nan)
    known = np.nan_to_num(residuals)
    resamples = min(_RESAMPLES, max(_FEWEST, _DRAWS // n))
    deviations = np.concatenate([c @ known / _totals(c, units.sizes) for c in _counts(n, resamples)])  # (R, M)
    tails = (1 - _LEVEL) / 2
    widening = stdtrit(n - 1, 1 - tails) / ndtri(1 - tails) * np.sqrt(n / (n - 1))
    low, high = np.quantile(deviations, [tails, 1 - tails], axis=0)
    with np.errstate(invalid="ignore"):  # an infinite mean has no interval
        mean = units.sums.sum(axis=0) / units.sizes.sum()
    mean[~finite] = np.nan
    return mean + widening * low, mean + widening * high


def differences(units: Units, pairs: Sequence[Pair]) -> Array:
    """Return half the length of the 95 % interval of each pair's difference of means (P,), valid for all pairs at once.

    pairs: numbers of methods (i, j); NaN for pairs with scores that are not finite, which do not count. There must be
    at least two units.
    """
    half = np.full(len(pairs), np.nan)
    finite = np.asarray(np.isfinite(units.sums).all(axis=0))
    known = [p for p, (i, j) in enumerate(pairs) if finite[i] and finite[j]]
    if known:
        units = Units(np.where(finite, units.sums, 0.0), units.sizes)
        chosen = [pairs[p] for p in known]
        errors = _standard_errors(units, chosen)
        half[known] = errors * _multiple(units, chosen, errors)
    return half


def _standard_errors(units: Units, pairs: Sequence[Pair]) -> Array:
    """(P,) of the differences of means, from the spread between units (Cochran 1977, sec. 6.4: a ratio's error)."""
    i, j = np.transpose(pairs)
    spread = units.residuals[:, i] - units.residuals[:, j]
    n = len(units.sizes)
    return np.asarray(np.sqrt((spread**2).sum(axis=0) * n / (n - 1)) / units.sizes.sum())


def _multiple(units: Units, pairs: Sequence[Pair], errors: Array) -> float:
    """How many standard errors half an interval has, so that all of them hold together in 95 % of tables.

    For one pair, Student's. For several, the quantile of the greatest t over the pairs in resamples, but no more than
    what Student's law and Sidak's inequality allow whatever the correlation: with few units, resamples that drew a
    unit repeatedly have errors near 0, and the quantile becomes far too great.
    """
    from scipy.special import stdtrit

    n = len(units.sizes)
    varying = errors > _EXACT * np.abs(units.sums).max(initial=0)
    count = int(varying.sum())
    if count == 0:
        return 0.0
    single, most = (float(stdtrit(n - 1, (1 + _LEVEL ** (1 / k)) / 2)) for k in (1, count))
    if count == 1:
        return single
    greatest = _greatest_t(units, [pair for pair, varies in zip(pairs, varying, strict=True) if varies])
    return min(max(float(np.quantile(greatest, _LEVEL, method="higher")), single), most)


def _greatest_t(units: Units, pairs: Sequence[Pair]) -> Array:
    """The greatest |t| over the pairs, in each resample (R,).

    With r a unit's residual, s its size, c how often it is drawn, and N = sum c s: the deviation of the mean is
    d = sum c r / N, its squared standard error n / (n - 1) sum c (r - d s)^2 / N^2.
    """
    r, s, n = units.residuals, units.sizes, len(units.sizes)
    i, j = np.transpose(pairs)
    made = []
    for counts in _counts(n, _FEWEST):
        total = _totals(counts, s)
        deviation, mixed = counts @ r / total, counts @ (r * s[:, None])
        greatest = np.zeros(len(counts))
        for part in _parts(len(pairs), len(counts)):
            a, b = i[part], j[part]
            d, m = deviation[:, a] - deviation[:, b], mixed[:, a] - mixed[:, b]
            squares = counts @ (r[:, a] - r[:, b]) ** 2 - 2 * d * m + d**2 * (counts @ s**2)[:, None]
            error = np.sqrt(np.maximum(squares, 0) * n / (n - 1)) / total
            with np.errstate(divide="ignore", invalid="ignore"):  # the same unit drawn n times has no spread
                t = np.where(error > _EXACT * np.abs(d), np.abs(d) / error, np.where(d == 0, 0.0, np.inf))
            greatest = np.maximum(greatest, t.max(axis=1))
        made.append(greatest)
    return np.concatenate(made)


def _parts(pairs: int, rows: int) -> Iterator[slice]:
    """Slices of the pairs, small enough for arrays of so many rows."""
    step = max(1, _AT_ONCE // rows)
    return (slice(start, start + step) for start in range(0, pairs, step))


def _totals(counts: Array, sizes: Array) -> Array:
    """The views in each resample (B, 1), or (1, 1) if all have as many. counts: (B, S); sizes: (S,) of the units."""
    return counts @ sizes[:, None] if (sizes != 1).any() else np.full((1, 1), len(sizes), dtype=np.float64)


def _counts(n: int, resamples: int) -> Iterator[Array]:
    """Yield how often each of n units is drawn in each resample, (B, n) at a time: always the same draws."""
    parts = _kept_draws(n, resamples) if n * resamples <= _KEPT_DRAWS else _draws(n, resamples)
    return (part.astype(np.float64) for part in parts)


@functools.lru_cache(maxsize=2)
def _kept_draws(n: int, resamples: int) -> Sequence[npt.NDArray[Any]]:
    """The draws for one column serve all columns of as many units."""
    return [*_draws(n, resamples)]


def _draws(n: int, resamples: int) -> Iterator[npt.NDArray[Any]]:
    """How often each unit is drawn, in as few bytes as hold it."""
    rng = np.random.default_rng(0)
    at_once = max(1, _AT_ONCE // n)
    for start in range(0, resamples, at_once):
        rows = min(at_once, resamples - start)
        drawn = rng.integers(n, size=(rows, n)) + n * np.arange(rows)[:, None]
        counts = np.bincount(drawn.ravel(), minlength=rows * n).reshape(rows, n)
        yield counts.astype(np.min_scalar_type(counts.max()))


def leads(units: Units, best: int) -> Array:
    """Return half the length of the interval of the best method's lead over each other one (M,).

    In at most 5 % of tables, any of these intervals excludes 0 for a method that is as good as the best. best: the
    number of the method with the best mean; NaN for it, and for pairs with scores that are not finite. There must be
    at least two units.
    """
    rivals, gaps = _rivals(units, best)
    half = np.full(len(gaps), np.nan)
    half[rivals] = [differences(units, [(best, m)])[0] for m in rivals]  # Student's, each by itself
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

    family: the pairs that are judged together while some methods are left; it has those of the reference.
    """
    left, gaps = _rivals(units, reference)
    half = np.full(len(gaps), np.nan)
    while left:
        pairs = family(left)
        of_pairs = dict(zip(pairs, differences(units, pairs), strict=True))
        half[left] = [of_pairs[reference, m] for m in left]
        behind = [m for m in left if gaps[m] <= half[m]]
        left = behind if len(behind) < len(left) else []
    return half


def _rivals(units: Units, reference: int) -> tuple[list[int], Array]:
    """The methods with an interval of their difference from a method, by number; and these differences' sizes (M,)."""
    finite = np.asarray(np.isfinite(units.sums).all(axis=0))
    sums = np.where(finite, units.sums, 0.0)
    rivals = [m for m in np.flatnonzero(finite).tolist() if m != reference] if finite[reference] else []
    return rivals, np.abs((sums - sums[:, [reference]]).sum(axis=0)) / units.sizes.sum()
