"""Agreement: of observers with each other, and of metrics with observers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.programs.people.bradley_terry import Preferences, Votes


@dataclass(frozen=True)
class Agreement:
    """alpha: Krippendorff's, 1 = full agreement, 0 = that of chance, NaN if undefined; n: pairs several judged."""

    alpha: float
    n: int


@dataclass(frozen=True)
class MetricAgreement:
    """tau: Kendall's, between a metric's order of the methods and people's; low, high: its 95 % interval.

    predicted: share of votes that were for the picture with the better score, ties left out; n: how many votes.
    """

    tau: float
    low: float
    high: float
    predicted: float
    n: int


def observer_agreement(votes: Votes) -> Agreement:
    """Return how far observers agree on the pairs of pictures that at least two of them judged.

    Which picture of a pair is called the first is arbitrary, so each vote counts as won and, mirrored, as lost: 0 is
    then the agreement of people who toss coins, whichever methods are compared.
    """
    judged: dict[tuple[int, int, int], dict[int, float]] = {}
    for first, second, won, view, observer in zip(
        votes.first, votes.second, votes.won, votes.view, votes.observer, strict=True
    ):
        is_turned = first > second
        pair = (int(view), int(min(first, second)), int(max(first, second)))
        judged.setdefault(pair, {})[int(observer)] = float(1 - won if is_turned else won)
    units = [list(judgements.values()) for judgements in judged.values() if len(judgements) > 1]
    mirrored = [[1 - value for value in unit] for unit in units]
    return Agreement(krippendorff([*units, *mirrored]), len(units))


def krippendorff(units: Sequence[Sequence[float]]) -> float:
    """Return Krippendorff's alpha for interval data (Krippendorff 2011): 1 - observed / expected disagreement.

    units: the values that each unit got, at least two; NaN if there are none, or all values are equal.
    """
    units = [unit for unit in units if len(unit) > 1]
    values = [value for unit in units for value in unit]
    n = len(values)
    if not n:
        return float("nan")
    observed = sum(2 * _squares(unit) / (len(unit) - 1) for unit in units) / n
    expected = 2 * _squares(values) / (n * (n - 1))
    return float(1 - observed / expected) if expected else float("nan")


def _squares(values: Sequence[float]) -> float:
    """The sum of squared differences of all pairs: n sum x^2 - (sum x)^2."""
    x = np.asarray(values, dtype=np.float64)
    return float(len(x) * (x**2).sum() - x.sum() ** 2)


def metric_agreement(scores: Array, is_lower_better: bool, votes: Votes, people: Preferences) -> MetricAgreement:
    """Return how a metric agrees with people.

    scores: (V, M) of each view and method, NaN = none. The interval is of a bootstrap over votes (or observers) and
    over views, both drawn anew.
    """
    better = -scores if is_lower_better else scores
    rng = np.random.default_rng(0)
    known = better[np.isfinite(better).all(axis=1)]
    if not len(known):
        return MetricAgreement(np.nan, np.nan, np.nan, np.nan, 0)
    drawn = (known[rng.integers(len(known), size=len(known))].mean(axis=0) for _ in people.resampled)
    taus = [kendall_tau(mean, preferences) for mean, preferences in zip(drawn, people.resampled, strict=True)]
    has_interval = np.isfinite(taus).any() and not people.want
    low, high = np.nanquantile(taus, [0.025, 0.975]) if has_interval else (np.nan, np.nan)
    predicted, n = _predicted(better, votes)
    return MetricAgreement(kendall_tau(known.mean(axis=0), people.scores), float(low), float(high), predicted, n)


def kendall_tau(one: Array, other: Array) -> float:
    """Return Kendall's tau-b of two scores (M,); NaN if one of them does not tell methods apart."""
    from scipy.stats import kendalltau

    return float(kendalltau(one, other).statistic) if np.ptp(one) and np.ptp(other) else float("nan")


def _predicted(better: Array, votes: Votes) -> tuple[float, int]:
    """How often the picture with the better score was preferred; equal scores count half."""
    decided = votes.of(votes.won != 0.5)
    gap = better[decided.view, decided.first] - better[decided.view, decided.second]
    there = np.isfinite(gap)
    hit = np.where(gap == 0, 0.5, (gap > 0) == (decided.won == 1))[there]
    return (float(hit.mean()), int(there.sum())) if there.any() else (float("nan"), 0)
