"""Relative global histogram stretching (Huang, Wang, Song, Sequeira & Mavromatis 2018, Shallow-water image enhancement
using relative global histogram stretching based on adaptive parameter acquisition, MMM).

Contrast: green and blue are scaled to mid gray, each channel is stretched from its range [I_min, I_max] to a desired
range [O_min, O_max], and noise is filtered. Colour: in L*a*b*, lightness is stretched and weak chroma raised. A
channel's histogram is modelled as a Rayleigh distribution of mode a, with sigma = sqrt((4 - pi) / 2) a = 0.655 a.
"""

import math
from dataclasses import dataclass

import numpy as np

from sucre_bench import Restoration, Scene, View, method
from sucre_bench.arrays import Array
from sucre_bench.imaging.cielab import from_lab, to_lab
from sucre_bench.imaging.filters import denoised
from sucre_bench.plugins.options import check_ranges

_SPREAD = math.sqrt((4 - math.pi) / 2)  # sigma / a
# shares of red, green and blue light that a metre of water leaves
_RESIDUAL = (
    0.83,
    0.95,
    0.97,
)
_KAPPA = (1.1, 0.9, 0.9)  # found by trial, in the publication
_CHROMA = 1.3  # phi: the factor of weak chroma; full chroma keeps its value
_LEVEL = 1 / 255  # a mode is a level of an 8-bit histogram


@method(
    requires=("cv2",),
    cites="Huang, Wang, Song, Sequeira & Mavromatis 2018",
    encoding="gamma",
    opinions={"SAUD": 54},
)
@dataclass(frozen=True)
class Rghs:
    """Stretch each channel to a range set by its histogram and its attenuation, then lightness and chroma.

    The method is made for shallow water. Red is stretched but not balanced, so a picture with little red stays cold.
    """

    distance_m: float = 3.0
    """Assumed distance of the scene, metres. A channel that loses more light on the way is stretched further."""

    tail: float = 0.1
    """Percent of the pixels on each side of a channel's mode that its range leaves out; 0 leaves out none."""

    noise: float = 0.1
    """Colour differences, in [0, 1], that the bilateral filter smooths as noise; 0 switches the filter off."""

    def __post_init__(self) -> None:
        check_ranges(self, distance_m="[0, 100]", tail="[0, 50)", noise="[0, 1]")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image, in [0, 1]."""
        mean = view.rgb.mean(axis=(0, 1), dtype=np.float64)
        # to mid gray, unless black
        gain = np.where(mean > 1e-6, 0.5 / np.maximum(mean, 1e-6), 1).astype(np.float32)
        gain[0] = 1
        rgb = view.rgb * gain  # not cut, so that none piles up at 1
        for channel in range(3):
            rgb[..., channel] = self._stretched(rgb[..., channel], channel)
        lab = to_lab(denoised(rgb, self.noise))
        low, high = np.percentile(lab[..., 0], [1, 99])  # of lightness: they become 0 and 100
        if high - low > 100 * _LEVEL:
            lab[..., 0] = ((lab[..., 0] - low) * (100 / (high - low))).clip(0, 100)
        lab[..., 1:] *= np.float32(_CHROMA) ** (1 - np.abs(lab[..., 1:] / 128))
        return Restoration(from_lab(lab))

    def _stretched(self, plane: Array, channel: int) -> Array:
        """Return the plane (H, W) moved from [I_min, I_max] to [O_min, O_max], cut at 0 and 1."""
        # 9: no bins for a lone bright pixel
        levels = np.rint(plane.clip(0, 9) / np.float32(_LEVEL)).astype(np.int64)
        mode = float(np.bincount(levels.ravel()).argmax()) * _LEVEL
        left, right = plane[plane < mode], plane[plane >= mode]
        low = float(np.percentile(left, self.tail)) if left.size else mode
        high = float(np.percentile(right, 100 - self.tail)) if right.size else mode
        if high - low < _LEVEL:
            return plane.clip(0, 1)
        bottom = min((1 - _SPREAD) * mode, low)  # a - sigma; no more than I_min
        top = _top(high, mode, _KAPPA[channel] * _RESIDUAL[channel] ** self.distance_m)
        return ((plane - low) * ((top - bottom) / (high - low)) + bottom).clip(0, 1)


def _top(high: float, mode: float, remaining: float) -> float:
    """O_max: the mean of (a + mu sigma) / (kappa t) over the whole numbers mu that put it in [I_max, 1], else 1."""
    sigma = _SPREAD * mode
    if sigma < _LEVEL or high >= 1:
        return 1.0
    first = math.ceil((remaining * high - mode) / sigma)
    last = math.floor((remaining - mode) / sigma)
    return (mode + (first + last) / 2 * sigma) / remaining if first <= last else 1.0
