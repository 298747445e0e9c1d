"""How far a mean may be off by chance: a hierarchical bootstrap over scenes, views within them, charts within those.

Views of a scene share its water, charts of a view share its light: they are no independent repetitions. So scenes are
drawn with replacement, from each drawn scene as many views as it has, from each drawn view as many charts (Davison and
Hinkley 1997, sec. 3.8). A resample's mean is over its views, each the mean of its charts. The methods of a table are
drawn together, so that differences between them are paired.

A bootstrap of n units has a spread that is too small by sqrt((n - 1) / n), and tails of the normal law instead of
Student's: intervals are widened by both, about the mean (Hesterberg 2015, sec. 5.3, does so to the tails' shares, which
the few different resamples of few units cannot follow). One level of normal data then gives Student's interval.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sucre_bench.arrays import Array

__all__ = ["interval", "resampled_means"]

# With 5000, half an interval differs between seeds by 2 %, with 2000 by 3 %: enough for its two figures.
_MOST, _LEAST = 5000, 2000
_DRAWS = 10_000_000  # more than these only for the least resamples
_AT_ONCE = 500_000  # units drawn at a time, about 30 MB

_Whole = NDArray[np.intp]


def resampled_means(values: Array, views: Sequence[int], charts: Sequence[int]) -> Array:
    """Return the means (K, R) of K values in R resamples; NaN where a value is not finite.

    values: (U, K), a row a chart (or a view without), those of a view together, the views of a scene too; views: (S,)
    how many of them are of each scene; charts: (V,) how many rows are of each view. What is drawn rests on these counts
    alone.
    """
    tree = [np.array([len(views)]), np.asarray(views, dtype=np.intp), np.asarray(charts, dtype=np.intp)]
    rng = np.random.default_rng(0)
    finite = np.isfinite(values).all(axis=0)
    known = np.where(finite, values, 0.0)
    at_once = max(1, _AT_ONCE // len(values))
    resamples = min(_MOST, max(_LEAST, _DRAWS // len(values)))
    sizes = [min(at_once, resamples - start) for start in range(0, resamples, at_once)]
    means: Array = np.concatenate([known.T @ _weights(rng, size, tree).T for size in sizes], axis=1)  # (K, U) @ (U, B)
    means[~finite] = np.nan
    return means


def _weights(rng: np.random.Generator, resamples: int, tree: Sequence[_Whole]) -> Array:
    """Draw what each leaf counts in each resample: (B, U), rows sum to 1. tree: children of each node, by level."""
    resample: _Whole = np.arange(resamples)
    node: _Whole = np.zeros(resamples, dtype=np.intp)  # what was drawn of the level above: the root, once a resample
    for children in tree:
        n, first = children[node], (np.cumsum(children) - children)[node]
        resample, first, n = np.repeat(resample, n), np.repeat(first, n), np.repeat(n, n)
        node = first + (rng.random(len(n)) * n).astype(np.intp)
    leaves = int(tree[-1].sum())
    counts = np.bincount(resample * leaves + node, weights=1 / n, minlength=resamples * leaves)
    weights: Array = np.asarray(counts, dtype=np.float64).reshape(resamples, leaves)  # a view's charts add up to 1
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def interval(resampled: Array, mean: Array, n: int) -> tuple[Array, Array]:
    """Return the ends of the 95 % intervals (K,) of means (K,), from resampled ones (K, R).

    n: how many units there are at the highest level that has more than one, at least 2.
    """
    from scipy.special import ndtri, stdtrit  # quantiles of the normal law and Student's

    widening = stdtrit(n - 1, 0.975) / ndtri(0.975) * np.sqrt(n / (n - 1))
    low, high = np.quantile(resampled, [0.025, 0.975], axis=-1)
    with np.errstate(invalid="ignore"):  # an infinite mean has no interval
        return mean + widening * (low - mean), mean + widening * (high - mean)
