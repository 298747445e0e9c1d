"""UICM, the colourfulness in UIQM: mean and spread of the opponent colours R - G and (R + G) / 2 - B."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.imaging.encoding import palette
from sucre_bench.imaging.once import once
from sucre_bench.imaging.percentiles import ValueCounts

_ALPHA = 0.1  # the share trimmed at each end


@dataclass(frozen=True, slots=True)
class Colourfulness:
    """The points on which implementations of UICM differ.

    trimmed_variance: var over the pixels mu is made of; wraparound: R - G and R + G modulo 256, as unsigned bytes do;
    rounded: both tails of the nearest whole number of pixels, sums divided by .8 of the pixels, a fraction too;
    first_output: the trimmed mean of R - G alone, the first of several results of a program; order: which channel is
    taken for R, G and B.
    """

    trimmed_variance: bool = False
    wraparound: bool = False
    rounded: bool = False
    first_output: bool = False
    order: str = "RGB"


def uicm(shown: npt.NDArray[Any], form: Colourfulness = Colourfulness()) -> float:
    """Return the colourfulness of a picture (H, W, 3) in [0, 1]; NaN where nothing has a colour."""
    opponents = _opponents(shown, form.wraparound, form.order)
    if not opponents:
        return float("nan")
    (mean_RG, var_RG), (mean_YB, var_YB) = (_trimmed(x, form) for x in opponents)
    if form.first_output:
        return mean_RG
    return float(-0.0268 * np.hypot(mean_RG, mean_YB) + 0.1586 * np.sqrt(var_RG + var_YB))


@once
def _opponents(shown: npt.NDArray[Any], wraparound: bool, order: str) -> tuple[ValueCounts, ...]:
    """R - G and (R + G) / 2 - B of every pixel."""
    colours = palette(shown)
    if not colours.counts.size:
        return ()
    R, G, B = colours.rgb.T[["RGB".index(channel) for channel in order]].astype(np.int32)
    RG, sum_RG = R - G, R + G
    if wraparound:
        RG, sum_RG = RG % 256, sum_RG % 256
    return _counted(RG, colours.counts), _counted(sum_RG - 2 * B, colours.counts, 2)


def _counted(x: npt.NDArray[np.int32], counts: npt.NDArray[np.int64], divisor: int = 1) -> ValueCounts:
    """Whole numbers from -512 on, over a divisor."""
    every = np.bincount(x + 512, weights=counts).astype(np.int64)
    there = np.flatnonzero(every)
    return ValueCounts.of((there - 512) / divisor, every[there])


def _trimmed(x: ValueCounts, form: Colourfulness) -> tuple[float, float]:
    """Mean and variance of an opponent colour."""
    if form.rounded:
        low, end = _nearest(_ALPHA * x.size), _nearest((1 - _ALPHA) * x.size)
        scale = (end - low) / ((1 - 2 * _ALPHA) * x.size)
    else:
        low, end, scale = int(np.ceil(_ALPHA * x.size)), x.size - int(np.floor(_ALPHA * x.size)), 1.0
    if low >= end:
        return float("nan"), float("nan")
    mean = scale * x.mean(low, end)
    return mean, scale * x.mean_square(mean, low, end) if form.trimmed_variance else x.mean_square(mean)


def _nearest(x: float) -> int:
    return int(np.floor(x + 0.5))
