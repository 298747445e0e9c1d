"""Shares of pixels: with a colour (coverage), with an impossible one (negative), made saturated red (saturated_red).
Also how many observations of the view a method used, over all views (observations)."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import CHANNELS, Array, coloured_pixels
from sucre_bench.imaging.chart_patches import chart_mask
from sucre_bench.imaging.visible_faults import is_red
from sucre_bench.plugins.plugin import metric
from sucre_bench.scene import Restoration, Score, View

# Half the width of the hues that count as red, degrees; the least saturation and value of HSV.
_HUE_DEG = 25.0
_SATURATION = 0.5
_VALUE = 0.1


@metric(
    role="coverage",
    needs={"restoration"},
    unit="share",
    better="higher",
    range=(0, 1),
    variants={
        "image": "of all pixels of the image",
        "depth": "of the pixels with depth; nothing without a depth map",
    },
)
@dataclass(frozen=True)
class Coverage:
    """Share of pixels that have a colour."""

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield one score, NaN where there is no pixel to cover; its n_pixels and coverage are those looked at."""
        if variant == "depth" and not view.has_depth:
            return
        given = coloured_pixels(restored.image)
        asked = view.depth > 0 if variant == "depth" else np.ones_like(given)
        value = float(given[asked].mean()) if asked.any() else np.nan
        yield Score(value, n_pixels=int(asked.sum()), coverage=float(asked.mean()))


@metric(
    needs={"restoration"},
    unit="share",
    better="lower",
    range=(0, 1),
    variants={
        "any": "of pixels with a colour, in any channel",
        "red": "in the red channel",
        "green": "in the green channel",
        "blue": "in the blue channel",
    },
)
@dataclass(frozen=True)
class Negative:
    """Share of coloured pixels with a negative computed intensity. No real scene has one, but a stretched picture hides
    it."""

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield one score, NaN where no pixel has a colour."""
        valid = coloured_pixels(restored.image)
        negative = np.zeros_like(valid)
        for channel in range(3) if variant == "any" else [CHANNELS.index(variant)]:
            negative |= restored.image[..., channel] < 0
        n = int(np.count_nonzero(valid))
        value = np.count_nonzero(negative & valid) / n if n else np.nan
        yield Score(value, n_pixels=n, coverage=float(valid.mean()))


@metric(
    may_need={"charts"},
    unit="share",
    better="lower",
    range=(0, 1),
    cites="Smith 1978",
    variants={
        "hsv": "hue within 25 degrees of red, saturation above .5 and value above .1, of HSV"
    },
)
@dataclass(frozen=True)
class SaturatedRed:
    """Share of coloured pixels outside the colour charts that are saturated red.

    Water takes red first. A method that divides by too small a transmission of red, or leaves too little veil, paints
    far or shaded places red. A scene with red things has such pixels too: compare methods, not scenes.
    """

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield one score, NaN where no pixel outside the charts has a colour."""
        counted = coloured_pixels(shown).copy()
        for chart in view.charts:
            counted &= ~chart_mask(chart, (shown.shape[1], shown.shape[0]))
        is_saturated = is_red(shown[counted], _HUE_DEG, _SATURATION, _VALUE)
        value = float(is_saturated.mean()) if is_saturated.size else np.nan
        yield Score(value, n_pixels=is_saturated.size, coverage=float(counted.mean()))


_OBSERVATIONS = {"all": "n_observations", "repeated": "n_repeated", "views": "n_views"}


@metric(
    role="observations",
    needs={"restoration"},
    unit="count",
    better="none",
    range=(0, np.inf),
    variants={
        "all": "observations of the view's pixels, in all views",
        "repeated": "pixels that are seen more than once",
        "views": "views with an observation, the view itself among them",
    },
)
@dataclass(frozen=True)
class Observations:
    """Number of observations that a multi-view method used, from its info (n_observations and others)."""

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield one score; nothing where the method does not tell."""
        count = restored.info.get(_OBSERVATIONS[variant])
        if count is not None:
            yield Score(
                float(count),
                n_pixels=int(restored.valid.sum()),
                coverage=float(restored.valid.mean()),
            )
