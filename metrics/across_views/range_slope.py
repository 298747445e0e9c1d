"""Range slope: how the restored light of a point still depends on the camera's distance.

Of each channel, with J the mean over a patch of 8 x 8 pixels, decoded to linear light, and z its distance from the
camera,

    slope = sum (z_i - z_j) (ln J_i - ln J_j) / sum (z_i - z_j)^2

over the patches of all pairs of views i, j. It is the least-squares slope of ln J on z with an intercept for each patch
(fixed effects), where a patch that n views show counts n times. Attenuation alone gives -beta. Veiling light adds light
with distance: in green and blue the input's slope may be near 0 or positive.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import NotApplicableError
from sucre_bench.imaging.encoding import srgb_decode
from sucre_bench.plugins.decorators import metric
from sucre_bench.restored_pair import RestoredPair, RestoredView
from sucre_bench.results.reasons import Reason
from sucre_bench.scene import Score

# Half of the smallest step of 8 bits, in linear light: less counts as this much.
_DARKEST = 0.5 / 255 / 12.92

_CHANNELS = {"red": 0, "green": 1, "blue": 2}

_SHOWN = "of the restored image: its normalisation, view by view, counts too"


@metric(
    needs={"restored_views", "depth", "poses"},
    unit="1/m",
    better="none",
    range=(-np.inf, np.inf),
    default=["red", "green", "blue"],
    symbol="slope of ln J on distance (1/m)",
    variants={
        "red": "of the red channel of J, what the method computed; needs a run with save=full",
        "green": "of the green channel of J",
        "blue": "of the blue channel of J",
        "mean": "mean of the three; slopes of opposite sign cancel",
        "shown-red": f"of the red channel {_SHOWN}",
        "shown-green": f"of the green channel {_SHOWN}",
        "shown-blue": f"of the blue channel {_SHOWN}",
        "shown-mean": f"mean of the three, {_SHOWN}",
    },
)
@dataclass(frozen=True)
class RangeSlope:
    """Slope of the logarithm of a point's restored light on its distance; 0 if the water is gone.

    Negative: the method corrects too little, far points stay dark. Positive: it corrects too much, or leaves haze.
    """

    def score_pair(self, pair: RestoredPair, variant: str) -> Iterator[Score]:
        """Yield the slope over the patches of the pair."""
        image, _, channel = variant.rpartition("-")
        slopes = _slopes(pair, image or "raw")
        if channel in _CHANNELS:
            yield slopes[_CHANNELS[channel]]
        else:
            yield _together(slopes, float(np.mean([slope.value for slope in slopes])))


@metric(
    needs={"restored_views", "depth", "poses"},
    unit="1/m",
    better="lower",
    range=(0, np.inf),
    variants={"raw": "of J, what the method computed; needs a run with save=full", "shown": _SHOWN},
)
@dataclass(frozen=True)
class RangeSlopeError:
    """Distance of `range_slope` from 0: root mean square over the channels."""

    def score_pair(self, pair: RestoredPair, variant: str) -> Iterator[Score]:
        """Yield the root mean square over the channels."""
        slopes = _slopes(pair, variant)
        yield _together(slopes, float(np.sqrt(np.mean([slope.value**2 for slope in slopes]))))


def _slopes(pair: RestoredPair, image: str) -> list[Score]:
    """The slope of each channel. image: "raw" for J, or "shown"."""
    means = pair.means(_image(pair.here, image), _image(pair.there, image))
    is_gamma = image == "shown" or pair.here.view.encoding == "gamma"
    light = [srgb_decode(mean) if is_gamma else mean for mean in means]
    change = np.diff(pair.points.distance, axis=0)[0]
    return [_slope(change, light[0][:, channel], light[1][:, channel]) for channel in _CHANNELS.values()]


def _image(restored: RestoredView, image: str) -> Array:
    if image == "shown":
        return restored.shown
    if restored.image is None:
        raise NotApplicableError(Reason.NOT_STORED.value)
    return restored.image


def _slope(change: Array, here: Array, there: Array) -> Score:
    """The slope of one channel. change: (P,) metres; here, there: (P,) linear light, NaN = unknown."""
    known = np.isfinite(here) & np.isfinite(there)
    known[known] &= np.maximum(here[known], there[known]) > _DARKEST  # else there is no light to compare
    z = change[known]
    ratio = np.log(np.maximum(there[known], _DARKEST)) - np.log(np.maximum(here[known], _DARKEST))
    weight = float(z @ z)
    value = float(z @ ratio) / weight if weight > 0 else np.nan
    return Score(value, n_pixels=int(known.sum()), coverage=float(known.mean()), weight=weight)


def _together(slopes: list[Score], value: float) -> Score:
    """A score of all channels; NaN if a channel has no slope."""
    n_pixels = min(slope.n_pixels for slope in slopes)
    coverage, weight = (float(np.mean([getattr(s, name) for s in slopes])) for name in ("coverage", "weight"))
    return Score(value, n_pixels=n_pixels, coverage=coverage, weight=weight)
