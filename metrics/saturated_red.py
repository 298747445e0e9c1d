"""The share of pixels that a restoration makes saturated red."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array, Mask, coloured_pixels
from sucre_bench.imaging.chart_patches import chart_mask
from sucre_bench.plugins.decorators import metric
from sucre_bench.scene import Restoration, Score, View

# Half the width of the hues that count as red, degrees; the least saturation and value of HSV.
_HUE_DEG, _SATURATION, _VALUE = 25.0, 0.5, 0.1


@metric(
    unit="share",
    better="lower",
    range=(0, 1),
    cites="Smith 1978",
    variants={"hsv": "hue within 25 degrees of red, saturation above .5 and value above .1, of HSV"},
)
@dataclass(frozen=True)
class SaturatedRed:
    """Share of coloured pixels outside the colour charts that are saturated red.

    Water takes red first. A method that divides by too small a transmission of red, or leaves too little veil, paints
    far or shaded places red. A scene with red things has such pixels too: compare methods, not scenes.
    """

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterator[Score]:
        """Yield one score, NaN where no pixel outside the charts has a colour."""
        counted = coloured_pixels(shown).copy()
        for chart in view.charts:
            counted &= ~chart_mask(chart, (shown.shape[1], shown.shape[0]))
        n = int(np.count_nonzero(counted))
        value = float(_is_saturated_red(shown[counted]).mean()) if n else np.nan
        yield Score(value, n_pixels=n, coverage=float(counted.mean()))


def _is_saturated_red(rgb: Array) -> Mask:
    """Return which colours (P, 3) are a saturated red.

    With red as the maximum, the hue of HSV is 60 degrees times (G - B) / (maximum - minimum), and the saturation is
    (maximum - minimum) / maximum.
    """
    red, green, blue = rgb.T
    chroma = red - np.minimum(green, blue)
    near = np.abs(green - blue) * 60 <= _HUE_DEG * chroma
    is_red = (red >= green) & (red >= blue) & near
    return np.asarray(is_red & (red > _VALUE) & (chroma > _SATURATION * red))
