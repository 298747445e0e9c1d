"""Scores of several restored views of a scene: does a method give one point the same colour in all of them?

No reference is needed: without the water, a point looks alike from everywhere. `Consistency` is the difference between
the colours, `PointContrast` how much colours differ at all, `RangeSlope` whether colours follow the distance. `matches`
has how many more points can be matched between views.

A colour is the mean over a patch of 8 x 8 pixels of the restored image, of those that have a colour in both views. A
constant picture has no differences at all: so the contrast stands beside them.

Range slope: how the restored light of a point still depends on the camera's distance.

Of each channel, with J the mean over a patch of 8 x 8 pixels, decoded to linear light, and z its distance from the
camera,

    slope = sum (z_i - z_j) (ln J_i - ln J_j) / sum (z_i - z_j)^2

over the patches of all pairs of views i, j. It is the least-squares slope of ln J on z with an intercept for each patch
(fixed effects). A patch that n views show counts n times. Attenuation alone gives -beta. Veiling light adds light with
distance: in green and blue the input's slope may be near 0 or positive.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import CHANNELS, Array, Mask
from sucre_bench.errors import NotApplicableError
from sucre_bench.imaging.cielab import ciede2000, contrast, lab_d50
from sucre_bench.imaging.encoding import srgb_decode
from sucre_bench.plugins.plugin import metric
from sucre_bench.restored_pair import RestoredPair
from sucre_bench.results.reasons import Reason
from sucre_bench.scene import Score

# Upper ends of the ranges of |difference in distance| that have a region of their own, metres.
_STEPS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)

# Patches that a range needs, and a pair.
_FEWEST = 5


@metric(
    role="change-with-distance",
    symbol=r"$\Delta E_{00}$ of a point between views",
    needs={"restored_views", "depth", "poses"},
    requires=["skimage"],
    unit="dE00",
    better="lower",
    range=(0, np.inf),
    default=["patches", "relative"],
    unranked=["patches"],
    cites="Sharma et al. 2005",
    variants={
        "patches": "means over patches of 8 x 8 pixels; not ranked: pictures without contrast have the least",
        "relative": "the same, over the mean difference between patches of a view; no unit",
    },
)
@dataclass(frozen=True)
class Consistency:
    """Mean CIEDE2000 difference between the colours of a point in two restored views."""

    def score_pair(self, pair: RestoredPair, variant: str) -> Iterator[Score]:
        """Yield the mean over the patches, then one for each range of difference in distance."""
        here, there, known = _lab(pair)
        share, n = float(known.mean()), int(known.sum())
        differences = ciede2000(here, there)
        if variant == "relative":
            total = float(n * (contrast(here) + contrast(there)) / 2)
            if not total:
                raise NotApplicableError(
                    "all points of a view have one colour; nothing to relate differences to"
                )
            yield Score(
                float(differences.sum()) / total, n_pixels=n, coverage=share, weight=total
            )
            return
        yield Score(float(differences.mean()), n_pixels=n, coverage=share, weight=n)
        change = np.abs(np.diff(pair.points.distance, axis=0)[0])[known]
        for low, high in zip((0.0, *_STEPS[:-1]), _STEPS, strict=True):
            inside = (change >= low) & (change < high)
            count = int(inside.sum())
            if count >= _FEWEST:
                yield Score(
                    float(differences[inside].mean()),
                    f"image/{low:g}-{high:g} m",
                    count,
                    share,
                    weight=count,
                )


@metric(
    needs={"restored_views", "depth", "poses"},
    requires=["skimage"],
    unit="dE00",
    better="none",
    range=(0, np.inf),
    variants={"patches": "means over patches of 8 x 8 pixels"},
)
@dataclass(frozen=True)
class PointContrast:
    """Mean CIEDE2000 difference between different points of a restored view that other views also show."""

    def score_pair(self, pair: RestoredPair, variant: str) -> Iterator[Score]:
        """Yield the mean over both views."""
        here, there, known = _lab(pair)
        share, n = float(known.mean()), int(known.sum())
        yield Score(
            (contrast(here) + contrast(there)) / 2, n_pixels=n, coverage=share, weight=n
        )


def _lab(pair: RestoredPair) -> tuple[Array, Array, Mask]:
    """CIE Lab (K, 3) of the patches that have a colour in both views, in each; and which of all these are (P,).

    Raises NotApplicableError if they are fewer than five.
    """
    here, there = pair.means(pair.here.shown, pair.there.shown)
    known = np.asarray(np.isfinite(here).all(axis=1))
    if known.sum() < _FEWEST:
        raise NotApplicableError(
            f"the two views have fewer than {_FEWEST} patches with colours in common"
        )
    return lab_d50(here[known]), lab_d50(there[known]), known


# Half of the smallest step of 8 bits, in linear light: less counts as this much.
_DARKEST = 0.5 / 255 / 12.92

_SHOWN = "of the restored image: its normalisation, view by view, counts too"


@metric(
    needs={"restored_views", "depth", "poses"},
    unit="1/m",
    better="none",
    range=(-np.inf, np.inf),
    default=CHANNELS,
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
        if channel in CHANNELS:
            yield slopes[CHANNELS.index(channel)]
        else:
            yield _together(slopes, float(np.mean([slope.value for slope in slopes])))


@metric(
    needs={"restored_views", "depth", "poses"},
    unit="1/m",
    better="lower",
    range=(0, np.inf),
    variants={
        "raw": "of J, what the method computed; needs a run with save=full",
        "shown": _SHOWN,
    },
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
    images = [
        side.shown if image == "shown" else side.image for side in (pair.here, pair.there)
    ]
    if images[0] is None or images[1] is None:
        raise NotApplicableError(Reason.NOT_STORED.value)
    means = pair.means(images[0], images[1])
    is_gamma = image == "shown" or pair.here.view.encoding == "gamma"
    light = [srgb_decode(mean) if is_gamma else mean for mean in means]
    # (P,) metres
    change = np.diff(pair.points.distance, axis=0)[0]
    slopes = []
    for here, there in zip(light[0].T, light[1].T, strict=True):
        known = np.isfinite(here) & np.isfinite(there)
        # else there is no light to compare
        known[known] &= np.maximum(here[known], there[known]) > _DARKEST
        z = change[known]
        ratio = np.log(np.maximum(there[known], _DARKEST)) - np.log(
            np.maximum(here[known], _DARKEST)
        )
        weight = float(z @ z)
        value = float(z @ ratio) / weight if weight > 0 else np.nan
        slopes.append(
            Score(value, n_pixels=int(known.sum()), coverage=float(known.mean()), weight=weight)
        )
    return slopes


def _together(slopes: list[Score], value: float) -> Score:
    """A score of all channels; NaN if a channel has no slope."""
    n_pixels = min(slope.n_pixels for slope in slopes)
    coverage, weight = (
        float(np.mean([getattr(s, name) for s in slopes])) for name in ("coverage", "weight")
    )
    return Score(value, n_pixels=n_pixels, coverage=coverage, weight=weight)
