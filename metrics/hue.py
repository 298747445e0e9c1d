"""The hue of chart patches (hue), and its distance from the expected hue (hue_error).

SUCRe tracks "the hue value" of each colour patch over distance and does not say which hue that is. "hsv" is taken as
meant: the angle on the hexagon of HSV (Smith 1978), of the shown picture's encoded RGB, against the sRGB list. "lab" is
the hue angle h_ab of CIE Lab under D50, against the maker's Lab list: differences of equal size look more alike there.
Both are in degrees, from red over yellow (hsv 60), green and blue. A gray (R = G = B) has none: NaN.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.chart_kinds import Patch
from sucre_bench.imaging.chart_patches import measure
from sucre_bench.imaging.cielab import lab_d50
from sucre_bench.metrics.chart_colours import chart_scores, patch_region
from sucre_bench.plugins.decorators import metric
from sucre_bench.scene import Restoration, Score, View

_LOST_DEG = 90.0  # the mean error of a hue at random


@metric(
    role="patch-hue",
    needs={"charts"},
    requires=["cv2", "skimage"],
    unit="deg",
    better="none",
    range=(0, 360),
    default=["hsv", "hsv-expected"],
    cites="Boittiaux et al. 2024",
    variants={
        "hsv": "the angle of HSV, measured",
        "hsv-expected": "the angle of HSV in the sRGB list",
        "lab": "h_ab of CIE Lab, measured",
        "lab-expected": "h_ab of the maker's Lab list",
    },
)
@dataclass(frozen=True)
class Hue:
    """Hue of each chromatic chart patch, degrees. A chart has no score, because a mean over its hues means nothing."""

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterator[Score]:
        """Yield a score per patch."""
        form, _, expected = variant.partition("-")
        for chart in view.charts:
            for reading in (r for r in measure(shown, chart) if r.patch.colour):
                value = expected_hue_deg(reading.patch, form) if expected else float(hue_deg(reading.rgb, form))
                yield Score(value, patch_region(chart, reading.patch), reading.n_pixels, reading.coverage)


@metric(
    needs={"charts"},
    requires=["cv2", "skimage"],
    unit="deg",
    better="lower",
    range=(0, 180),
    cites="Boittiaux et al. 2024",
    variants={"hsv": "of HSV, against the sRGB list", "lab": "h_ab of CIE Lab under D50, against the maker's Lab list"},
)
@dataclass(frozen=True)
class HueError:
    """Mean angle, either way round, between measured and expected hue of the chromatic chart patches, degrees.

    A patch that has lost its hue, blown out to white say, counts 90, as far off as a hue at random is on average.
    """

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterator[Score]:
        """Yield a score per chart and per patch."""
        for chart in view.charts:
            readings = [r for r in measure(shown, chart) if r.patch.colour]
            expected = np.array([expected_hue_deg(r.patch, variant) for r in readings])
            rgb = np.array([r.rgb for r in readings])
            off = np.abs(turn_deg(hue_deg(rgb, variant), expected))
            is_gray = np.isnan(off) & np.isfinite(rgb).all(axis=-1)
            yield from chart_scores(chart, readings, np.where(is_gray, _LOST_DEG, off))


def hue_deg(rgb: Array, form: str) -> Array:
    """Return the hue of gamma-encoded sRGB (..., 3), degrees in [0, 360), NaN for grays. form: "hsv" or "lab"."""
    from skimage.color import rgb2hsv

    rgb = np.asarray(rgb, dtype=np.float64)
    has_hue = np.ptp(rgb, axis=-1) > 0  # False for NaN
    safe = np.where(has_hue[..., None], rgb, [1.0, 0, 0])
    angle = 360 * rgb2hsv(safe)[..., 0] if form == "hsv" else _lab_hue_deg(lab_d50(safe))
    return np.asarray(np.where(has_hue, angle % 360, np.nan))


def expected_hue_deg(patch: Patch, form: str) -> float:
    """Return the hue that a patch should have, degrees in [0, 360)."""
    return float(hue_deg(np.array(patch.srgb), form) if form == "hsv" else _lab_hue_deg(np.array(patch.lab)))


def turn_deg(hue: Array, reference: Array) -> Array:
    """Return how far a hue is from a reference, the shorter way round: degrees in [-180, 180)."""
    return np.asarray((np.asarray(hue) - reference + 180) % 360 - 180)


def _lab_hue_deg(lab: Array) -> Array:
    return np.asarray(np.degrees(np.arctan2(lab[..., 2], lab[..., 1])) % 360)
