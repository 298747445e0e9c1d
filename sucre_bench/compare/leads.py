"""95 % intervals of the differences from one method: the best, or a baseline.

They are fewer than those of all pairs, so they are judged in steps (step-down max-t: Romano and Wolf 2005, sec. 4).
Methods that differ by more than chance leave, and the others are judged anew by shorter intervals.

Which method is the best is seen only in the scores, so the family of its leads is all pairs of the methods that are
left. But if the best method beats every other one by the pair's own Student's interval, it leads them all, however many
they are (Hung and Fithian 2019): to do this by chance, it must beat a method that is as good as itself.
"""

from collections.abc import Callable
from itertools import combinations

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.compare.bootstrap import Pair, Units, differences


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
