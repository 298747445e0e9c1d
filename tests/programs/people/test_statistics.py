"""Scores from votes: the maximum of the likelihood, and intervals that hold the truth as often as they say."""

import numpy as np
import pytest

from sucre_bench.programs.people.statistics import (
    Votes,
    fit,
    kendall_tau,
    krippendorff,
    observer_agreement,
    preferences,
    pseudo_values,
)


def voted(
    scores: list[float], n_observers: int, per_observer: int, rng: np.random.Generator
) -> Votes:
    """Votes by Bradley and Terry's model, on pairs drawn at random."""
    true, n = np.array(scores), n_observers * per_observer
    first = rng.integers(len(true), size=n)
    second = (first + rng.integers(1, len(true), size=n)) % len(true)
    won = (rng.random(n) < 1 / (1 + np.exp(true[second] - true[first]))).astype(float)
    view, observer = rng.integers(5, size=n), np.repeat(np.arange(n_observers), per_observer)
    return Votes(len(true), first, second, won, view, observer)


def of_two(won: list[float], n_observers: int = 1) -> Votes:
    """Votes on two methods in one view: 1 for the first, 0 for the second, by observers in turn."""
    none = np.zeros(len(won), int)
    return Votes(2, none, none + 1, np.array(won), none, np.arange(len(won)) % n_observers)


def test_of_two_methods_the_score_is_the_log_odds_of_the_votes():
    low, high = fit(of_two([1.0] * 75 + [0.0] * 25))[::-1]
    # with half a vote more each way
    assert high - low == pytest.approx(np.log(75.5 / 25.5), abs=0.001)
    assert high + low == pytest.approx(0)


def test_ties_draw_scores_together():
    few, many = (fit(of_two([1.0] * 20 + [0.0] * 5 + [0.5] * ties))[0] for ties in (2, 15))
    assert 0 < many < few


def test_intervals_hold_the_true_scores_in_95_percent_of_studies():
    """Within what 40 studies of four methods allow: 89 to 99.5 %."""
    true, rng = [1.2, 0.4, -0.4, -1.2], np.random.default_rng(3)
    held, first = [], 0
    for _ in range(40):
        found = preferences(voted(true, 6, 20, rng), resamples=50)
        held += [
            low <= score <= high
            for low, score, high in zip(found.low, true, found.high, strict=True)
        ]
        first += int(np.argmax(found.scores) == 0)
    assert 0.89 <= np.mean(held) <= 0.995
    assert first >= 35


@pytest.mark.parametrize(
    ("won", "n_observers", "want"),
    [
        ([1.0], 1, "30 votes of 6 people are needed, these are 1 vote of 1"),
        ([1.0, 0.0] * 14, 7, "these are 28 votes of 7"),
        ([1.0, 0.0] * 20, 5, "these are 40 votes of 5"),
        ([1.0] * 30, 6, ""),
        ([0.5] * 30, 8, ""),
        ([1.0] * 29 + [0.0], 8, ""),
    ],
)
def test_intervals_need_30_votes_of_6_people(won: list[float], n_observers: int, want: str):
    found = preferences(of_two(won, n_observers), 20)
    assert want in found.want
    assert bool(found.want) == bool(want)
    assert np.isfinite([*found.low, *found.high, *found.difference(0, 1)[1:]]).all() != bool(
        want
    )


def test_votes_that_all_agree_have_the_interval_of_firths_method():
    """30 of 30: log(30.5 / 0.5), and the variance 1 / 30.5 + 1 / 0.5 of a log-odds (Firth 1993, Haldane 1956)."""
    gap, low, high = preferences(of_two([1.0] * 30, 6), 20).difference(0, 1)
    assert gap == pytest.approx(np.log(61), abs=1e-4)
    assert (high - low) / 2 == pytest.approx(1.96 * np.sqrt(1 / 30.5 + 2), abs=1e-3)
    assert low > 0


def test_values_of_views_have_the_score_as_their_mean():
    votes = voted([1.0, 0.0, -1.0], 3, 30, np.random.default_rng(1))
    values = pseudo_values(votes, 5)
    assert values.mean(axis=0) == pytest.approx(fit(votes))
    assert values.std(axis=0).min() > 0.05


def test_krippendorffs_alpha_is_the_published_one():
    """Krippendorff 2011, "Computing Krippendorff's Alpha-Reliability", section D: 0.849 for interval data."""
    missing = None
    raters = [
        [1, 2, 3, 3, 2, 1, 4, 1, 2, missing, missing, missing],
        [1, 2, 3, 3, 2, 2, 4, 1, 2, 5, missing, 3],
        [missing, 3, 3, 3, 2, 3, 4, 2, 2, 5, 1, missing],
        [1, 2, 3, 3, 2, 4, 4, 1, 2, 5, 1, missing],
    ]
    units = [
        [float(value) for value in unit if value is not None]
        for unit in zip(*raters, strict=True)
    ]
    assert krippendorff(units) == pytest.approx(0.849, abs=5e-4)
    assert krippendorff([[1.0, 1.0], [0.0, 0.0]]) == 1
    assert np.isnan(krippendorff([[1.0, 1.0]]))


def test_agreement_does_not_depend_on_which_method_is_called_first():
    """Two observers, ten pairs of pictures: they agree on nine, so alpha is near 1 - 2 x 0.1."""
    pairs, none = np.tile(np.arange(10), 2), np.zeros(20, int)
    won = np.array([1.0] * 10 + [1.0] * 9 + [0.0])
    observers = np.repeat([0, 1], 10)
    first, *others = (
        observer_agreement(Votes(2, one, other, mine, pairs, observers))
        for one, other, mine in (
            (none, none + 1, won),
            (none + 1, none, won),
            (none, none + 1, 1 - won),
        )
    )
    assert first.n == 10
    assert first.alpha == pytest.approx(0.8, abs=0.02)
    for other in others:
        assert (other.n, other.alpha) == pytest.approx((first.n, first.alpha))


def test_tau_counts_pairs_in_order():
    assert kendall_tau(np.array([1.0, 2, 3]), np.array([5.0, 6, 7])) == 1
    assert kendall_tau(np.array([1.0, 2, 3]), np.array([6.0, 5, 7])) == pytest.approx(1 / 3)
    assert np.isnan(kendall_tau(np.array([1.0, 1, 1]), np.array([5.0, 6, 7])))
