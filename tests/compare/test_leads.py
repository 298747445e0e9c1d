"""Leads of the best method, and differences from a baseline: simulated scores of which it is known who is better."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from sucre_bench.compare.statistics import Units, changes, differences, leads

pytestmark = pytest.mark.short

EFFECT = 1.5  # of the standard deviation of a paired difference


def scores(means: list[float], n: int, rng: np.random.Generator) -> np.ndarray:
    """(V, M): differences of two methods have a standard deviation of 1."""
    return means + rng.normal(size=(n, len(means))) / np.sqrt(2)


def led(views: np.ndarray) -> tuple[int, np.ndarray]:
    """The best method, and which methods it leads by more than chance."""
    mean = views.mean(axis=0)
    best = int(mean.argmax())
    return best, mean[best] - mean > leads(Units.of(views, [len(views)]), best)


def false_leads(means: list[float], n: int, tables: int) -> float:
    """The share of tables in which the best leads a method that is as good."""
    rng, truth = np.random.default_rng(len(means)), np.array(means)
    found = [led(scores(means, n, rng)) for _ in range(tables)]
    return float(np.mean([(behind & (truth >= truth[best])).any() for best, behind in found]))


def at_most(tables: int) -> float:
    """5 %, and three standard errors of a share of so many tables."""
    return 0.05 + 3 * float(np.sqrt(0.05 * 0.95 / tables))


FAR = -4.0


@pytest.mark.parametrize(
    ("means", "n", "tables"),
    [
        ([0] * 2, 8, 600),
        ([0] * 3, 8, 400),
        ([0] * 5, 8, 300),
        ([0] * 18, 8, 60),
        ([0] * 5, 20, 150),
        ([0, 0, *[FAR] * 3], 8, 600),  # those far behind leave, and two are judged like a pair
        ([0, 0, 0, *[FAR] * 15], 8, 100),
    ],
)
def test_nineteen_of_twenty_tables_have_no_false_lead(means: list[float], n: int, tables: int):
    assert false_leads(means, n, tables) < at_most(tables)


@pytest.mark.parametrize(
    ("others", "least"), [([], 0.9), ([FAR] * 16, 0.9), (np.linspace(-2, -9, 16).tolist(), 0.9), ([-EFFECT] * 3, 0.8)]
)
def test_a_lead_over_the_second_is_found_however_many_others_there_are(others: list[float], least: float):
    """Eight views. By intervals for all pairs of 18 methods it is found in 16 % of tables."""
    rng = np.random.default_rng(1)
    found = [led(scores([0, -EFFECT, *others], 8, rng)) for _ in range(150)]
    assert np.mean([best == 0 and behind[1] for best, behind in found]) > least


def test_of_two_methods_the_interval_is_students():
    gains = np.random.default_rng(2).normal(EFFECT, 1, size=8)
    half = leads(Units.of(np.stack([gains, np.zeros(8)], axis=1), [8]), 0)
    assert half[1] == pytest.approx(stats.t.ppf(0.975, 7) * gains.std(ddof=1) / np.sqrt(8))
    assert np.isnan(half[0])


def test_a_second_copy_of_the_best_is_equal_and_costs_nothing():
    rng = np.random.default_rng(3)
    views = scores([0, -2, -2.5], 8, rng)
    twice = np.concatenate([views[:, :1], views], axis=1)
    alone, beside = leads(Units.of(views, [8]), 0), leads(Units.of(twice, [8]), 0)
    assert beside[1] == 0
    assert beside[2:] == pytest.approx(alone[1:])


@pytest.mark.parametrize("others", [[0.0] * 4, [-3.0] * 4, [-3.0, 3.0, 0.0, 0.0]])
def test_nineteen_of_twenty_tables_have_no_false_difference_from_a_baseline(others: list[float]):
    rng, truth = np.random.default_rng(4), np.array([0.0, *others])
    false = 0
    for _ in range(400):
        views = scores(truth.tolist(), 8, rng)
        gaps = np.abs(views.mean(axis=0) - views[:, 0].mean())
        false += ((gaps > changes(Units.of(views, [8]), 0)) & (truth == 0)).any()
    assert false / 400 < at_most(400)


def test_methods_that_surely_differ_from_a_baseline_cost_the_others_nothing():
    rng = np.random.default_rng(5)
    views = scores([0, 1, *[20.0] * 16], 8, rng)
    half = changes(Units.of(views, [8]), 0)
    assert half[1] == pytest.approx(differences(Units.of(views[:, :2], [8]), [(0, 1)])[0])


def test_infinite_scores_have_no_interval_and_harm_no_other():
    views = scores([0, -2, -2], 8, np.random.default_rng(6))
    units = Units.of(np.concatenate([views, np.full((8, 1), np.inf)], axis=1), [8])
    for judge in (leads, changes):
        assert np.isnan(judge(units, 3)).all()
        assert judge(units, 0)[:3] == pytest.approx(judge(Units.of(views, [8]), 0), nan_ok=True)
