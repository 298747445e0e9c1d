"""Colour charts: angle (psi), CIEDE2000 (de00) and chroma of grays, of measured against expected patches.

All score the shown picture, in [0, 1] and gamma-encoded. A chart yields one score named after it, the mean over its
patches, and one per patch, "<chart>/<number>-<name>". Where a patch has no value (no pixel with a colour; for psi also
a median of exactly black, which has no direction) its score is NaN with coverage 0, and the mean of the chart leaves it
out. The coverage of the chart, the share of its patches' pixels that were scored, shows this. `patch_colour` has the
colours themselves, for tables of swatches.
"""

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.chart_kinds import Patch
from sucre_bench.imaging.chart_patches import PatchReading, measure
from sucre_bench.imaging.cielab import ciede2000, lab_d50, srgb_of_lab_d50
from sucre_bench.plugins.decorators import metric
from sucre_bench.scene import Chart, Restoration, Score, View


@metric(
    role="chart-error",
    symbol=r"mean angle $\bar\psi$ (°)",
    needs={"charts"},
    requires=["cv2"],
    unit="deg",
    better="lower",
    range=(0, 180),
    cites="Berman et al. 2021",
    variants={
        "colour": "the chromatic patches against the sRGB list (SUCRe's; DGK: patches 7-18)",
        "colour-lab": "the chromatic patches against the maker's Lab list, taken to sRGB and clipped to its gamut",
        "gray": "the gray patches against pure gray (Berman's)",
        "all": "all patches against the sRGB list",
    },
)
@dataclass(frozen=True)
class Psi:
    """Mean angle in RGB between measured and expected chart patches, degrees (psi-bar).

    It sees hue and saturation, not brightness. SUCRe averages it over the colour patches, Berman et al. over the grays.
    """

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterator[Score]:
        """Yield a score per chart and per patch."""
        readings = [
            [r for r in measure(shown, chart) if variant == "all" or r.patch.colour != (variant == "gray")]
            for chart in view.charts
        ]
        yield from _scored(view, readings, angle_deg, lambda patch: _expected_rgb(patch, variant))


@metric(
    role="colour-difference",
    symbol=r"$\Delta E_{00}$",
    needs={"charts"},
    requires=["cv2", "skimage"],
    unit="dE00",
    better="lower",
    range=(0, np.inf),
    cites="Sharma et al. 2005",
    variants={
        "lab": "the chromatic patches against the maker's Lab list",
        "srgb": "the chromatic patches against the sRGB list",
    },
)
@dataclass(frozen=True)
class De00:
    """Mean CIEDE2000 difference between measured and expected chart patches.

    Both are compared in CIE Lab under D50, the white of the maker's list; sRGB is brought there from D65 by Bradford's
    adaptation. Neither Sea-thru nor SUCRe says which list is meant: on the unrestored Sea-thru charts the two means are
    within .3 of each other (35.3 and 35.5), single patches up to 11 apart.
    """

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterator[Score]:
        """Yield a score per chart and per patch."""
        readings = [[r for r in measure(shown, chart) if r.patch.colour] for chart in view.charts]

        def difference(rgb: Array, lab: Array) -> Array:
            return ciede2000(lab_d50(rgb), lab)

        yield from _scored(view, readings, difference, lambda patch: _expected_lab(patch, variant))


def _scored(
    view: View,
    readings: Sequence[Sequence[PatchReading]],
    error: Callable[[Array, Array], Array],
    expected: Callable[[Patch], Array],
) -> Iterator[Score]:
    """Compare what each chart's patches show with what is expected, all charts at once."""
    every = [reading for of_chart in readings for reading in of_chart]
    if not every:
        return
    values = error(np.array([r.rgb for r in every]), np.array([expected(r.patch) for r in every]))
    ends = np.cumsum([len(of_chart) for of_chart in readings])
    for chart, of_chart, of_patches in zip(view.charts, readings, np.split(values, ends[:-1]), strict=True):
        yield from chart_scores(chart, of_chart, of_patches)


def angle_deg(a: Array, b: Array) -> Array:
    """Return the angle between colours a and b (..., 3), degrees; NaN where one is black or not a number.

    Source: SUCRe, the definition of psi-bar.
    """
    norms = np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1)
    cosine = (a * b).sum(axis=-1) / np.where(norms > 0, norms, np.nan)
    return np.asarray(np.degrees(np.arccos(cosine.clip(-1, 1))))  # rounding may lift it above 1


def patch_region(chart: Chart, patch: Patch) -> str:
    """Return the region of a patch's scores, "<chart>/<number>-<name>"."""
    return f"{chart.name}/{patch.number}-{patch.name}"


def chart_scores(chart: Chart, readings: Sequence[PatchReading], values: Array) -> Iterator[Score]:
    """Yield a score for the chart, the mean of its patches' values (P,), then one for each patch."""
    known = np.isfinite(values)
    used = np.array([r.n_pixels for r in readings]) * known
    seen = np.array([r.coverage for r in readings]) * known
    value = float(values[known].mean()) if known.any() else np.nan
    yield Score(value, chart.name, int(used.sum()), float(seen.mean()))
    for reading, score, n, coverage in zip(readings, values, used, seen, strict=True):
        yield Score(float(score), patch_region(chart, reading.patch), int(n), float(coverage))


@functools.lru_cache(maxsize=4096)
def _expected_rgb(patch: Patch, variant: str) -> Array:
    if variant == "gray":
        return np.ones(3)
    return srgb_of_lab_d50(np.array(patch.lab)) if variant == "colour-lab" else np.array(patch.srgb)


@functools.lru_cache(maxsize=4096)
def _expected_lab(patch: Patch, variant: str) -> Array:
    return np.array(patch.lab) if variant == "lab" else lab_d50(np.array(patch.srgb))


@metric(
    symbol=r"chroma of grays $C^*_{ab}$",
    needs={"charts"},
    requires=["cv2"],
    unit="C*ab",
    better="lower",
    range=(0, np.inf),
    cites="CIE 15:2004",
    variants={"chroma": "C*ab = sqrt(a*^2 + b*^2) of CIE Lab under D50"},
)
@dataclass(frozen=True)
class Neutral:
    """Mean chroma of the gray patches of a chart, as the picture shows them.

    A picture without a colour cast shows them gray, with chroma 0. A patch that is black or blown out to white has no
    chroma either, so read it beside psi or dE00.
    """

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterator[Score]:
        """Yield a score per chart and per gray patch."""
        for chart in view.charts:
            readings = [reading for reading in measure(shown, chart) if not reading.patch.colour]
            lab = lab_d50(np.array([reading.rgb for reading in readings]).reshape(-1, 3))
            yield from chart_scores(chart, readings, np.hypot(lab[:, 1], lab[:, 2]))


CHANNELS = ("red", "green", "blue")


@metric(
    role="patch-colour",
    needs={"charts"},
    requires=["cv2"],
    unit="",
    better="none",
    range=(0, 1),
    default=[*CHANNELS, *(f"{channel}-expected" for channel in CHANNELS)],
    variants={
        **dict.fromkeys(CHANNELS, "measured, gamma-encoded"),
        **{f"{channel}-expected": "in the sRGB list" for channel in CHANNELS},
    },
)
@dataclass(frozen=True)
class PatchColour:
    """Intensity of each chart patch, grays as well: the median over the patch, one channel a variant."""

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterator[Score]:
        """Yield a score per patch."""
        channel, _, expected = variant.partition("-")
        c = CHANNELS.index(channel)
        for chart in view.charts:
            for reading in measure(shown, chart):
                value = float(reading.patch.srgb[c] if expected else reading.rgb[c])
                yield Score(value, patch_region(chart, reading.patch), reading.n_pixels, reading.coverage)
