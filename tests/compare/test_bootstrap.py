"""Intervals against what they promise: simulated data of known mean, and Student's interval where it is exact."""

from __future__ import annotations

import tracemalloc
from collections.abc import Sequence

import numpy as np
import pytest
from scipy import stats

from sucre_bench.compare.bootstrap import interval, resampled_means

SIMULATED = 1000


def missed(values: np.ndarray, views: Sequence[int], charts: Sequence[int], n: int) -> float:
    """How often the intervals of columns (U, K) whose true mean is 0 do not hold it."""
    per_view = np.add.reduceat(values, np.cumsum([0, *charts[:-1]])) / np.array(charts)[:, None]
    low, high = interval(resampled_means(values, views, charts), per_view.mean(axis=0), n)
    return float(((low > 0) | (high < 0)).mean())


@pytest.mark.parametrize("n", [2, 3, 4, 8])
def test_of_equal_methods_one_pair_in_twenty_is_told_apart_however_few_the_views(n: int):
    """Differences of views, true mean 0. Two standard errors of the share itself: 1.4 %."""
    values = np.random.default_rng(n).normal(size=(n, SIMULATED))
    assert missed(values, [n], [1] * n, n) == pytest.approx(0.055, abs=0.025)


@pytest.mark.parametrize("n", [4, 8, 30])
def test_with_normal_data_intervals_are_as_wide_as_students(n: int):
    values = np.random.default_rng(n).normal(size=(n, 500))
    low, high = interval(resampled_means(values, [n], [1] * n), values.mean(axis=0), n)
    students = 2 * stats.t.ppf(0.975, n - 1) * values.std(axis=0, ddof=1) / np.sqrt(n)
    assert np.mean((high - low) / students) == pytest.approx(1, abs=0.05)


def test_views_of_a_scene_are_not_independent():
    """Ten scenes of six views, half of the variance between scenes: to take the views alone for what varies promises
    far too much; scenes, then views, keeps the promise."""
    scenes, views = 10, 6
    rng = np.random.default_rng(0)
    values = np.repeat(rng.normal(size=(scenes, SIMULATED)), views, axis=0) + rng.normal(
        size=(scenes * views, SIMULATED)
    )
    assert missed(values, [views] * scenes, [1] * scenes * views, scenes) < 0.06
    assert missed(values, [scenes * views], [1] * scenes * views, scenes * views) > 0.2


def test_scenes_of_different_size_keep_the_promise():
    views = [2, 3, 5, 12, 8, 4]
    rng = np.random.default_rng(1)
    values = np.repeat(rng.normal(size=(6, SIMULATED)), views, axis=0) + rng.normal(size=(sum(views), SIMULATED))
    assert missed(values, views, [1] * sum(views), 6) < 0.07


def test_charts_of_a_view_are_not_independent():
    """Twelve views of four charts, their light the greater part of the variance."""
    rng = np.random.default_rng(2)
    values = np.repeat(rng.normal(size=(12, SIMULATED)), 4, axis=0) + 0.3 * rng.normal(size=(48, SIMULATED))
    assert missed(values, [12], [4] * 12, 12) < 0.06
    assert missed(values, [48], [1] * 48, 48) > 0.2


def test_resamples_spread_as_the_theory_of_two_stages_says():
    """Davison and Hinkley 1997, sec. 3.8: the variance of means drawn in two stages is the sum of both stages'."""
    rng = np.random.default_rng(3)
    scenes, views = 6, 5
    values = rng.normal(size=(scenes, views)) + 2 * rng.normal(size=(scenes, 1))
    means = resampled_means(values.reshape(-1, 1), [views] * scenes, [1] * scenes * views)[0]
    expected = values.mean(axis=1).var() / scenes + values.var(axis=1).mean() / (scenes * views)
    assert means.var() == pytest.approx(expected, rel=0.08)
    assert means.mean() == pytest.approx(values.mean(), abs=0.06)


def test_a_view_counts_once_however_many_charts_it_has():
    values = np.array([[0.0], *[[1.0]] * 9])
    means = resampled_means(values, [2], [1, 9])[0]
    assert set(np.round(means, 12)) == {0, 0.5, 1}
    assert means.mean() == pytest.approx(0.5, abs=0.03)


def test_views_count_alike_whichever_scene_they_are_of():
    """One scene of one view, one of three: 1/4 of the views in the mean, but drawn as often as the other."""
    means = resampled_means(np.array([[1.0], [0.0], [0.0], [0.0]]), [1, 3], [1] * 4)[0]
    assert set(np.round(means, 12)) == {0, 0.25, 1}


def test_draws_are_the_same_every_time():
    values = np.random.default_rng(4).normal(size=(7, 3))
    state = np.random.get_state()[1].tolist()
    assert (resampled_means(values, [7], [1] * 7) == resampled_means(values, [7], [1] * 7)).all()
    assert np.random.get_state()[1].tolist() == state


def test_what_is_not_finite_has_no_interval_and_harms_no_other():
    values = np.array([[1.0, np.inf], [2.0, 3.0], [4.0, 3.0]])
    mean = values.mean(axis=0)
    low, high = interval(resampled_means(values, [3], [1] * 3), mean, 3)
    assert low[0] < mean[0] < high[0]
    assert np.isnan([low[1], high[1]]).all()


def test_thousands_of_views_take_little_memory():
    """All weights at once would be 2000 x 8000 numbers, 128 MB."""
    values = np.zeros((8000, 8))
    tracemalloc.start()
    resampled_means(values, [2000], [4] * 2000)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 60e6
