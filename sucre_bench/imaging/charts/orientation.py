"""Checks the order of a chart's corners by its patches.

Water dims and tints a chart, but keeps each channel of its patches nearly an increasing, straight function of what
is expected: I = a J + b, a > 0. The share of the patches' variance that such lines explain tells how well a reading
fits, and that of the same corners begun elsewhere whether they were begun in the wrong place.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.charts.patches import measure
from sucre_bench.scene import Chart

# On eight charts of Sea-thru's D5, 1.5 to 10 m away, the right order explains .69 to .93, any other at most .15.
_LEAST, _CLEARLY = 0.4, 0.2


@dataclass(frozen=True, slots=True)
class Order:
    """How well patches fit.

    explained: share of variance, 0 to 1, NaN where it is not known; turn: which corner, 0 to 3, should be the first.
    """

    explained: float
    turn: int

    @property
    def fault(self) -> str:
        """What is wrong, in words; empty where nothing is."""
        if self.turn:
            first = ("top left", "top right", "bottom right", "bottom left")[self.turn]
            return f"the patches are in order if the corner marked {first} is the top left one"
        if math.isnan(self.explained):
            return "too few patches have a colour to tell whether they are in order"
        if self.explained < _LEAST:
            said = f"{self.explained:.0%} explained"
            return f"the patches' colours do not follow the chart's ({said}): wrong place or kind"
        return ""


def reading_order(shown: Array, chart: Chart) -> Order:
    """Tell how well a chart's patches fit their place. shown: (H, W, 3), NaN where there is no colour.

    Patches without a colour are left out; with fewer than six left nothing is known: explained is NaN, turn 0.
    Raises InputError as `measure` does.
    """
    fits = []
    for turn in range(4):
        readings = measure(shown, replace(chart, corners=np.roll(chart.corners, -turn, axis=0)))
        measured = np.array([reading.rgb for reading in readings])
        expected = np.array([reading.patch.srgb for reading in readings])
        seen = np.isfinite(measured).all(axis=1)
        fits.append(_explained(expected[seen], measured[seen]) if seen.sum() >= 6 else np.nan)
    if not np.isfinite(fits).all():
        return Order(np.nan, 0)
    best = int(np.argmax(fits))
    wrong = fits[best] > fits[0] + _CLEARLY and fits[best] >= _LEAST
    return Order(float(fits[0]), best if wrong else 0)


def _explained(expected: Array, measured: Array) -> float:
    """The share of measured's variance (P, 3) that is a rising line of expected's, all channels together."""
    x, y = expected - expected.mean(axis=0), measured - measured.mean(axis=0)
    covariance, total = (x * y).sum(axis=0).clip(0), (y * y).sum()
    return float((covariance**2 / (x * x).sum(axis=0)).sum() / total) if total > 0 else 0.0
