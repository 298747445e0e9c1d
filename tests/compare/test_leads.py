"""Leads of the best method, and differences from a baseline: simulated scores of which it is known who is better."""

from collections.abc import Sequence

import numpy as np
import pytest
import scipy

from sucre_bench.compare.statistics import Units, changes, differences, leads

pytestmark = pytest.mark.short

EFFECT = 1.5  # of the standard deviation of a paired difference


def scores(means: list[float], n: int, rng: np.random.Generator) -> np.ndarray:
    """(V, M): differences of two methods have a standard deviation of 1."""
    return means + rng.normal(size=(n, len(means))) / np.sqrt(2)


def led(
    views: np.ndarray, scenes: Sequence[int] = (), in_order: bool = False
) -> tuple[int, np.ndarray]:
    """The best method, and which methods it leads by more than chance."""
    mean = views.mean(axis=0)
    best = int(mean.argmax())
    units = Units.of(views, scenes or [len(views)], in_order)
    return best, mean[best] - mean > leads(units, best)


def false_leads(means: list[float], n: int, tables: int) -> float:
    """The share of tables in which the best leads a method that is as good."""
    rng, truth = np.random.default_rng(len(means)), np.array(means)
    found = [led(scores(means, n, rng)) for _ in range(tables)]
    return float(np.mean([(behind & (truth >= truth[best])).any() for best, behind in found]))


def at_most(tables: int, share: float = 0.05) -> float:
    """The share, and three standard errors of a share of so many tables."""
    return share + 3 * float(np.sqrt(share * (1 - share) / tables))


FAR = -4.0


@pytest.mark.parametrize(
    ("means", "n", "tables"),
    [
        ([0] * 5, 8, 150),
        ([0] * 18, 8, 40),
        ([0, 0, *[FAR] * 3], 8, 300),  # those far behind leave, and two are judged like a pair
    ],
)
def test_nineteen_of_twenty_tables_have_no_false_lead(means: list[float], n: int, tables: int):
    assert false_leads(means, n, tables) < at_most(tables)


@pytest.mark.parametrize(
    ("others", "least"), [(np.linspace(-2, -9, 16).tolist(), 0.9), ([-EFFECT] * 3, 0.8)]
)
def test_a_lead_over_the_second_is_found_however_many_others_there_are(
    others: list[float], least: float
):
    """Eight views. By intervals for all pairs of 18 methods it is found in 16 % of tables."""
    rng = np.random.default_rng(1)
    found = [led(scores([0, -EFFECT, *others], 8, rng)) for _ in range(150)]
    assert np.mean([best == 0 and behind[1] for best, behind in found]) > least


@pytest.mark.parametrize("others", [[0.0] * 4, [-3.0, 3.0, 0.0, 0.0]])
def test_nineteen_of_twenty_tables_have_no_false_difference_from_a_baseline(
    others: list[float],
):
    rng, truth = np.random.default_rng(4), np.array([0.0, *others])
    false = 0
    for _ in range(200):
        views = scores(truth.tolist(), 8, rng)
        gaps = np.abs(views.mean(axis=0) - views[:, 0].mean())
        false += ((gaps > changes(Units.of(views, [8]), 0)) & (truth == 0)).any()
    assert false / 200 < at_most(200)


def track(n: int, methods: int, alike: float, rng: np.random.Generator) -> np.ndarray:
    """(V, M) of equal methods: neighbours have the correlation `alike`."""
    views = rng.normal(size=(n, methods))
    for v in range(1, n):
        views[v] = alike * views[v - 1] + np.sqrt(1 - alike**2) * views[v]
    return views


@pytest.mark.parametrize(
    ("n", "methods", "alike"), [(4, 2, 0.8), (8, 6, 0.5), (8, 2, 0.8), (20, 2, 0.8)]
)
def test_neighbours_that_are_alike_seldom_make_a_false_lead(n: int, methods: int, alike: float):
    """Taken as independent, they make one in 25 to 80 % of tables."""
    tables, false = 200, np.zeros(2)
    rng = np.random.default_rng(8)
    for _ in range(tables):
        views = track(n, methods, alike, rng)
        false += [led(views, in_order=in_order)[1].any() for in_order in (True, False)]
    assert false[0] / tables < at_most(tables, 0.07)
    assert false[1] / tables > 0.18


def test_the_error_of_neighbours_is_that_of_a_series_with_their_correlation():
    views = track(24, 2, 0.4, np.random.default_rng(1))
    units = Units.of(views, [24], in_order=True)
    assert 0 < units.alike < 0.8
    places = np.arange(24)
    correlations = units.alike ** np.abs(places - places[:, None])
    gain = views[:, 0] - views[:, 1]
    # what a sample variance is of, on average
    variance = gain.var(ddof=0) / (1 - correlations.mean())
    error = np.sqrt(variance * correlations.mean())
    freedom = max(3, 23 / (24 * correlations.mean()))
    assert differences(units, [(0, 1)])[0] == pytest.approx(
        scipy.stats.t.ppf(0.975, freedom) * error
    )
    assert units.worth == pytest.approx(1 / correlations.mean())


def test_views_that_are_not_alike_are_judged_as_without_an_order():
    views = np.stack([[1.0, 3, 1, 3, 1, 3], np.zeros(6)], axis=1)
    ordered, unordered = (Units.of(views, [6], in_order) for in_order in (True, False))
    assert np.array_equal(leads(ordered, 0), leads(unordered, 0), equal_nan=True)
    assert ordered.worth == 6


@pytest.mark.parametrize("between", [0.0, 1.0])
@pytest.mark.parametrize("sizes", [[3, 4, 5, 16], [2, 3, 12, 30]])
def test_few_scenes_of_different_size_seldom_make_a_false_lead(
    sizes: list[int], between: float
):
    """With as many degrees of freedom as for equal scenes, in up to 18 % of tables."""
    rng, tables = np.random.default_rng(9), 500
    false = 0
    for _ in range(tables):
        of_scenes = np.repeat(between * rng.normal(size=(4, 2)), sizes, axis=0)
        views = of_scenes + rng.normal(size=(sum(sizes), 2))
        false += led(views, sizes)[1].any()
    assert false / tables < at_most(tables, 0.07)
