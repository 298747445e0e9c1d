"""Colour charts: angle (psi), CIEDE2000 (de00), hue and chroma of grays, of measured against expected patches.

All score the shown picture, in [0, 1] and gamma-encoded. A chart yields one score named after it, the mean over its
patches, and one per patch, "<chart>/<number>-<name>". Where a patch has no value (no pixel with a colour; for psi also
a median of exactly black, which has no direction) its score is NaN with coverage 0. The mean of the chart leaves it
out. The coverage of the chart, the share of its patches' pixels that were scored, shows this. `patch_colour` has the
colours themselves, for tables of swatches.

SUCRe tracks "the hue value" of each colour patch over distance and does not say which hue that is. "hsv" is taken as
meant: the angle on the hexagon of HSV (Smith 1978), of the shown picture's encoded RGB, against the sRGB list. "lab" is
the hue angle h_ab of CIE Lab under D50, against the maker's Lab list: differences of equal size look more alike there.
Both are in degrees, from red over yellow (hsv 60), green and blue. A gray (R = G = B) has none: NaN.
"""

import functools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import CHANNELS, Array
from sucre_bench.imaging.chart_kinds import Patch
from sucre_bench.imaging.chart_patches import PatchReading, measure
from sucre_bench.imaging.cielab import ciede2000, lab_d50, srgb_of_lab_d50
from sucre_bench.plugins.plugin import metric
from sucre_bench.scene import Restoration, Score, View

_LOST_DEG = 90.0  # the mean error of a hue at random


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
        "colour-measured": "the chromatic patches against their reflectances under D65, where measured",
        "gray": "the gray patches against pure gray (Berman's)",
        "all": "all patches against the sRGB list",
    },
)
@dataclass(frozen=True)
class Psi:
    """Mean angle in RGB between measured and expected chart patches, degrees (psi-bar).

    It sees hue and saturation, not brightness. SUCRe averages it over the colour patches, Berman et al. over the grays.
    """

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield a score per chart and per patch."""
        which = None if variant == "all" else variant != "gray"
        yield from _scored(
            shown,
            view,
            which,
            lambda rgb, patches: angle_deg(rgb, _expected_rgb(patches, variant)),
        )


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
        "measured": "the chromatic patches against their reflectances under D65, where measured",
    },
)
@dataclass(frozen=True)
class De00:
    """Mean CIEDE2000 difference between measured and expected chart patches.

    Both are compared in CIE Lab under D50, the white of the maker's list; sRGB is brought there from D65 by Bradford's
    adaptation. Neither Sea-thru nor SUCRe says which list is meant. On the unrestored Sea-thru charts the two means are
    within .3 of each other (35.3 and 35.5), single patches up to 11 apart.
    """

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield a score per chart and per patch."""

        def difference(rgb: Array, patches: tuple[Patch, ...]) -> Array:
            return ciede2000(lab_d50(rgb), _expected_lab(patches, variant))

        yield from _scored(shown, view, True, difference)


def _scored(
    shown: Array,
    view: View,
    coloured: bool | None,
    error: Callable[[Array, tuple[Patch, ...]], Array],
) -> Iterator[Score]:
    """Yield for each chart the mean of its patches' errors, then each patch's error.

    coloured: whether chromatic patches or grays are scored; None for all. error: of measured colours (P, 3) of the
    patches (P,) of all charts at once, (P,).
    """
    readings = [
        [r for r in measure(shown, chart) if coloured in (None, r.patch.is_chromatic)]
        for chart in view.charts
    ]
    every = [reading for of_chart in readings for reading in of_chart]
    if not every:
        return
    values = error(np.array([r.rgb for r in every]), tuple(r.patch for r in every))
    ends = np.cumsum([len(of_chart) for of_chart in readings])
    for chart, of_chart, of_patches in zip(
        view.charts, readings, np.split(values, ends[:-1]), strict=True
    ):
        known = np.isfinite(of_patches)
        used = np.array([r.n_pixels for r in of_chart]) * known
        seen = np.array([r.coverage for r in of_chart]) * known
        value = float(of_patches[known].mean()) if known.any() else np.nan
        yield Score(
            value, chart.name, int(used.sum()), float(seen.mean()) if len(seen) else np.nan
        )
        for reading, score, n, coverage in zip(of_chart, of_patches, used, seen, strict=True):
            yield Score(
                float(score), f"{chart.name}/{reading.patch.label}", int(n), float(coverage)
            )


def _patches(
    shown: Array,
    view: View,
    value: Callable[[PatchReading], float],
    *,
    only_coloured: bool = False,
) -> Iterator[Score]:
    """Yield a value for each patch of each chart; charts have no score of their own."""
    for chart in view.charts:
        for reading in measure(shown, chart):
            if reading.patch.is_chromatic or not only_coloured:
                region = f"{chart.name}/{reading.patch.label}"
                yield Score(value(reading), region, reading.n_pixels, reading.coverage)


def angle_deg(a: Array, b: Array) -> Array:
    """Return the angle between colours a and b (..., 3), degrees; NaN where one is black or not a number.

    Source: SUCRe, the definition of psi-bar.
    """
    norms = np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1)
    cosine = (a * b).sum(axis=-1) / np.where(norms > 0, norms, np.nan)
    return np.asarray(np.degrees(np.arccos(cosine.clip(-1, 1))))  # rounding may lift it above 1


@functools.lru_cache(maxsize=64)
def _expected_rgb(patches: tuple[Patch, ...], variant: str) -> Array:
    if variant == "gray":
        return np.ones((len(patches), 3))
    if variant == "colour-lab":
        return srgb_of_lab_d50(np.array([patch.lab for patch in patches]))
    if variant == "colour-measured":
        return _measured_rgb(patches)
    return np.array([patch.srgb for patch in patches])


@functools.lru_cache(maxsize=64)
def _expected_lab(patches: tuple[Patch, ...], variant: str) -> Array:
    if variant == "lab":
        return np.array([patch.lab for patch in patches])
    return lab_d50(
        _measured_rgb(patches)
        if variant == "measured"
        else np.array([patch.srgb for patch in patches])
    )


def _measured_rgb(patches: tuple[Patch, ...]) -> Array:
    """The colours of measured reflectances (P, 3); NaN for patches whose reflectance nobody measured."""
    return np.array([patch.measured or (np.nan,) * 3 for patch in patches])


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

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield a score per chart and per gray patch."""
        yield from _scored(
            shown, view, False, lambda rgb, patches: np.hypot(*lab_d50(rgb).T[1:])
        )


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

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield a score per patch."""
        channel, _, expected = variant.partition("-")
        c = CHANNELS.index(channel)
        yield from _patches(
            shown, view, lambda r: float(r.patch.srgb[c] if expected else r.rgb[c])
        )


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

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield a score per patch."""
        form, _, expected = variant.partition("-")

        def hue(r: PatchReading) -> float:
            return expected_hue_deg(r.patch, form) if expected else float(hue_deg(r.rgb, form))

        yield from _patches(shown, view, hue, only_coloured=True)


@metric(
    needs={"charts"},
    requires=["cv2", "skimage"],
    unit="deg",
    better="lower",
    range=(0, 180),
    cites="Boittiaux et al. 2024",
    variants={
        "hsv": "of HSV, against the sRGB list",
        "lab": "h_ab of CIE Lab under D50, against the maker's Lab list",
    },
)
@dataclass(frozen=True)
class HueError:
    """Mean angle, either way round, between measured and expected hue of the chromatic chart patches, degrees.

    A patch that has lost its hue, blown out to white say, counts 90, as far off as a hue at random is on average.
    """

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield a score per chart and per patch."""

        def error(rgb: Array, patches: tuple[Patch, ...]) -> Array:
            off = np.abs(
                turn_deg(
                    hue_deg(rgb, variant),
                    np.array([expected_hue_deg(p, variant) for p in patches]),
                )
            )
            is_gray = np.isnan(off) & np.isfinite(rgb).all(axis=-1)
            return np.where(is_gray, _LOST_DEG, off)

        yield from _scored(shown, view, True, error)


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
    return float(
        hue_deg(np.array(patch.srgb), form)
        if form == "hsv"
        else _lab_hue_deg(np.array(patch.lab))
    )


def turn_deg(hue: Array, reference: Array) -> Array:
    """Return how far a hue is from a reference, the shorter way round: degrees in [-180, 180)."""
    return np.asarray((np.asarray(hue) - reference + 180) % 360 - 180)


def _lab_hue_deg(lab: Array) -> Array:
    return np.asarray(np.degrees(np.arctan2(lab[..., 2], lab[..., 1])) % 360)
