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

    tau: float = np.nan
    low: float = np.nan
    high: float = np.nan
    predicted: float = np.nan
    n: int = 0


def observer_agreement(votes: Votes) -> Agreement:
    """Return how far observers agree on the pairs of pictures that at least two of them judged.

    Which picture of a pair is called the first is arbitrary, so each vote counts as won and, mirrored, as lost: 0 is
    then the agreement of people who toss coins, whichever methods are compared.
    """
    first, second = np.minimum(votes.first, votes.second), np.maximum(votes.first, votes.second)
    won = np.where(votes.first > votes.second, 1 - votes.won, votes.won)
    judged: dict[tuple[int, ...], dict[int, float]] = {}
    for view, one, other, observer, value in zip(votes.view, first, second, votes.observer, won, strict=True):
        judged.setdefault((view, one, other), {})[observer] = float(value)
    units = [list(judgements.values()) for judgements in judged.values() if len(judgements) > 1]
    mirrored = [[1 - value for value in unit] for unit in units]
    return Agreement(krippendorff([*units, *mirrored]), len(units))


def krippendorff(units: Sequence[Sequence[float]]) -> float:
    """Return Krippendorff's alpha for interval data (Krippendorff 2011): 1 - observed / expected disagreement.

    units: the values that each unit got, at least two; NaN if there are none, or all values are equal.
    """
    units = [unit for unit in units if len(unit) > 1]
    values = [value for unit in units for value in unit]
    expected = np.var(values, ddof=1) if values else 0.0
    # Twice the variance of a unit is the mean squared difference of its pairs.
    observed = sum(len(unit) * np.var(unit, ddof=1) for unit in units) / max(len(values), 1)
    return float(1 - observed / expected) if expected else float("nan")


def metric_agreement(scores: Array, is_lower_better: bool, votes: Votes, people: Preferences) -> MetricAgreement:
    """Return how a metric agrees with people.

    scores: (V, M) of each view and method, NaN = none. The interval is of a bootstrap over votes (or observers) and
    over views, both drawn anew.
    """
    better = -scores if is_lower_better else scores
    known = better[np.isfinite(better).all(axis=1)]
    if not len(known):
        return MetricAgreement()
    rng, low, high = np.random.default_rng(0), np.nan, np.nan
    drawn = (known[rng.integers(len(known), size=len(known))].mean(axis=0) for _ in people.resampled)
    taus = [kendall_tau(mean, preferences) for mean, preferences in zip(drawn, people.resampled, strict=True)]
    if np.isfinite(taus).any() and not people.want:
        low, high = np.nanquantile(taus, [0.025, 0.975])
    decided = votes.of(votes.won != 0.5)
    gap = better[decided.view, decided.first] - better[decided.view, decided.second]
    # How often the picture with the better score was preferred; equal scores count half.
    hit = np.where(gap == 0, 0.5, (gap > 0) == (decided.won == 1))[np.isfinite(gap)]
    predicted = float(hit.mean()) if len(hit) else np.nan
    return MetricAgreement(kendall_tau(known.mean(axis=0), people.scores), float(low), float(high), predicted, len(hit))


def kendall_tau(one: Array, other: Array) -> float:
    """Return Kendall's tau-b of two scores (M,); NaN if one of them does not tell methods apart."""
    from scipy.stats import kendalltau

    return float(kendalltau(one, other).statistic) if np.ptp(one) and np.ptp(other) else float("nan")
