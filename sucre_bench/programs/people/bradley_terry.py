"""Bradley-Terry scores of methods from pairwise votes, with bootstrap intervals.

The model: a person prefers method i to j with probability 1 / (1 + exp(s_j - s_i)) (Bradley and Terry 1952). Scores are
log-odds with mean 0. A tie counts half a vote each way. The fit is that of the library choix (iterative Luce spectral
ranking, Maystre and Grossglauser 2015), regularised as if each pair had a tenth of a vote more each way, so that a
method that won or lost every vote has a finite score.

An interval is the score +- 1.96 bootstrap standard errors. In simulations of 60 to 200 votes it held the true score in
95 to 98 % of studies, percentiles of the bootstrap in 90 to 95 %. From six observers on, whole observers are drawn:
their votes are not independent, and the interval is for people like them. With fewer, votes are drawn, and the interval
is for these observers alone. Few votes, and votes that all agree, get no interval: `want`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array, Mask
from sucre_bench.machine.text_formats import counted

Numbers = npt.NDArray[np.intp]

FEWEST_OBSERVERS = 6  # to draw whole observers
# With fewer votes, votes of fewer people, or votes that all agree a bootstrap has hardly a spread, whatever is true.
_FEWEST_VOTES, _FEWEST_PEOPLE = 20, 3
_PRIOR = 0.1
_RESAMPLES = 500
_LEVEL = 0.95


@dataclass(frozen=True, eq=False)
class Votes:
    """Votes of all observers, an entry a vote.

    methods: how many there are; first, second: (N,) numbers of the two methods; won: (N,) 1 if the first was preferred,
    0 if the second, 0.5 for a tie; view: (N,) number of the view; observer: (N,) number of the observer.
    """

    methods: int
    first: Numbers
    second: Numbers
    won: Array
    view: Numbers
    observer: Numbers

    def __len__(self) -> int:
        return len(self.first)

    def of(self, chosen: Numbers | Mask) -> Votes:
        """Return some of the votes, by number or mask."""
        pair, won = (self.first[chosen], self.second[chosen]), self.won[chosen]
        return Votes(self.methods, *pair, won, self.view[chosen], self.observer[chosen])

    @property
    def wins(self) -> Array:
        """(M, M): how often method i was preferred to j, ties half."""
        counts = np.zeros((self.methods, self.methods))
        np.add.at(counts, (self.first, self.second), self.won)
        np.add.at(counts, (self.second, self.first), 1 - self.won)
        return counts


@dataclass(frozen=True, eq=False)
class Preferences:
    """Scores (M,) in log-odds, mean 0; low, high: (M,) ends of their 95 % intervals, NaN without them.

    want: what is missing for intervals, empty if they are there; resampled: (R, M) scores of the bootstrap;
    over_observers: whether it drew observers, else votes; widening: how many standard errors half an interval has.
    """

    scores: Array
    low: Array
    high: Array
    resampled: Array
    over_observers: bool
    widening: float
    want: str

    def difference(self, i: int, j: int) -> tuple[float, float, float]:
        """Return the score of i less that of j, and the ends of its 95 % interval, NaN without one."""
        gap = float(self.scores[i] - self.scores[j])
        half = self.widening * float((self.resampled[:, i] - self.resampled[:, j]).std())
        return gap, gap - half, gap + half


def fit(votes: Votes, start: Array | None = None) -> Array:
    """Return the scores (M,) of votes, log-odds with mean 0. start: scores to begin at."""
    import choix

    begin = None if start is None else np.array(start, dtype=np.float64)
    wins = votes.wins.astype(np.float64)
    scores = choix.ilsr_pairwise_dense(wins, alpha=_PRIOR, initial_params=begin, tol=1e-6)
    return np.asarray(np.round(scores - scores.mean(), 9))  # the fit has no further digits; equal methods are equal


def preferences(votes: Votes, resamples: int = _RESAMPLES) -> Preferences:
    """Return scores, with intervals where the votes suffice for them; always the same draws.

    There must be a vote, and at least two methods.
    """
    from scipy.special import stdtrit

    scores = fit(votes)
    rng = np.random.default_rng(0)
    observers = np.unique(votes.observer)
    over_observers = len(observers) >= FEWEST_OBSERVERS
    # What is drawn: whole observers, or single votes.
    groups = [np.flatnonzero(votes.observer == one) for one in observers] if over_observers else np.arange(len(votes))
    n = len(groups)
    drawn = ([groups[g] for g in rng.integers(n, size=n)] for _ in range(resamples))
    resampled = np.stack([fit(votes.of(np.hstack(some)), scores) for some in drawn])

    wins, want = votes.wins, ""
    if len(votes) < _FEWEST_VOTES or len(observers) < _FEWEST_PEOPLE:
        these = f"these are {counted(len(votes), 'vote')} of {len(observers)}"
        want = f"{_FEWEST_VOTES} votes of {_FEWEST_PEOPLE} people are needed, {these}"
    elif ((wins == 0) | (wins.T == 0)).all() or (votes.won == 0.5).all():
        want = "all votes agree; ask more people, and for more views"
    # Student's for n independent units, and the bootstrap's own bias undone.
    widening = math.nan if want else float(stdtrit(n - 1, (1 + _LEVEL) / 2)) * math.sqrt(n / (n - 1))
    half = widening * resampled.std(axis=0)
    return Preferences(scores, scores - half, scores + half, resampled, over_observers, widening, want)


def pseudo_values(votes: Votes, n_views: int) -> Array:
    """Return the jackknife value of each view and method (V, M); its mean over views is the score of all votes.

    It is V s - (V - 1) s_v (Efron and Tibshirani 1993, ch. 11), s being the score over all V views, s_v that without
    votes on the view, shifted so that the mean over views is s. Of one view it is s.
    """
    scores = fit(votes)
    if n_views < 2:
        return scores[None]
    without = np.stack([fit(votes.of(votes.view != view), scores) for view in range(n_views)])
    values = n_views * scores - (n_views - 1) * without
    return np.asarray(values + scores - values.mean(axis=0))
