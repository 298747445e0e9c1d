"""Intervals against what they promise: simulated data of known mean, and Student's interval where it is exact."""

from itertools import combinations

import numpy as np
import pytest
import scipy

from sucre_bench.compare import statistics
from sucre_bench.compare.statistics import Units, differences, mean_intervals, pseudo_values

pytestmark = pytest.mark.short

SIMULATED = 1000


def missed(views: np.ndarray, scenes: list[int]) -> float:
    """How often the intervals of columns (V, K) whose true mean is 0 do not hold it."""
    low, high = mean_intervals(Units.of(views, scenes))
    return float(((low > 0) | (high < 0)).mean())


@pytest.mark.parametrize(
    ("scenes", "views", "between"),
    [
        *((1, views, 0.0) for views in (2, 3, 4, 8)),
        (4, 4, 0.0),
        (4, 4, 1.0),
        (10, 6, 1.0),
    ],
)
def test_the_interval_of_a_mean_misses_it_once_in_twenty(
    scenes: int, views: int, between: float
):
    """However few the views, and whether scenes differ or not. Two standard errors of the share itself: 1.4 %."""
    rng = np.random.default_rng(views)
    of_scenes = np.repeat(rng.normal(size=(scenes, SIMULATED)), views, axis=0)
    values = between * of_scenes + rng.normal(size=(scenes * views, SIMULATED))
    assert missed(values, [views] * scenes) == pytest.approx(0.055, abs=0.025)
    if between:
        assert missed(values, [scenes * views]) > 0.15  # views alone promise far too much


@pytest.mark.parametrize(("n", "of_views"), [(4, 1.0), (8, 0.3)])
def test_scores_of_pairs_keep_the_promise_as_pseudo_values_and_not_as_they_are(
    n: int, of_views: float
):
    """Each pair's score has a part of either view and one of its own; a view's score is the mean over its pairs."""
    rng = np.random.default_rng(n)
    views = of_views * rng.normal(size=(n, SIMULATED))
    pairs = rng.normal(size=(n, n, SIMULATED))
    pairs = views[:, None] + views + (pairs + pairs.transpose(1, 0, 2)) / np.sqrt(2)
    pairs[np.arange(n), np.arange(n)] = 0
    scores = pairs.sum(axis=1) / (n - 1)
    assert np.allclose(pseudo_values(scores).mean(axis=0), scores.mean(axis=0))
    assert missed(pseudo_values(scores), [n]) < 0.08
    assert missed(scores, [n]) > 0.12


def test_the_error_of_a_difference_is_that_of_the_theory_of_clusters():
    """Scenes of equal size: the variance of the difference's mean is that of the scenes' means over their number."""
    values = np.random.default_rng(3).normal(size=(6, 5, 2)) + np.random.default_rng(4).normal(
        size=(6, 1, 2)
    )
    (half,) = differences(Units.of(values.reshape(30, 2), [5] * 6), [(0, 1)])
    of_scenes = (values[..., 0] - values[..., 1]).mean(axis=1)
    assert half == pytest.approx(
        scipy.stats.t.ppf(0.975, 5) * of_scenes.std(ddof=1) / np.sqrt(6)
    )


def test_methods_that_are_nearly_the_same_cost_the_others_little():
    """Eighteen methods of which six each are nearly one: intervals are narrower than those of 18 different methods."""
    rng = np.random.default_rng(8)
    groups = np.repeat(rng.normal(size=(60, 3)), 6, axis=1) + 0.01 * rng.normal(size=(60, 18))
    pairs = list(combinations(range(18), 2))
    half = differences(Units.of(groups, [60]), pairs)[pairs.index((0, 17))]
    gain = groups[:, 0] - groups[:, 17]
    error = gain.std(ddof=1) / np.sqrt(60)
    independent = scipy.stats.t.ppf((1 + 0.95 ** (1 / len(pairs))) / 2, 59)
    assert scipy.stats.t.ppf(0.975, 59) < half / error < 0.95 * independent


def test_views_count_alike_whichever_scene_they_are_of():
    """One scene of one view, one of three: the mean moves by what the scene's views are of all that are drawn."""
    low, high = mean_intervals(Units.of(np.array([[1.0], [0.0], [0.0], [0.0]]), [1, 3]))
    widening = scipy.stats.t.ppf(0.975, 1) / scipy.stats.norm.ppf(0.975) * np.sqrt(2)
    assert (low[0], high[0]) == pytest.approx((0.25 - widening * 0.25, 0.25 + widening * 0.75))


def test_draws_are_the_same_in_every_process():
    units = Units.of(np.random.default_rng(4).normal(size=(7, 3)), [7])
    found = []
    for _ in range(2):
        statistics._resamples.cache_clear()  # noqa: SLF001 - what another process does not have
        found.append([*mean_intervals(units), differences(units, [(0, 1), (0, 2), (1, 2)])])
    assert np.array_equal(*found)
