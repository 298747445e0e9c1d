"""Differences of a point's colour between restored views, and between points of a view.

A colour is the mean over a patch of 8 x 8 pixels of the restored image, of those that have a colour in both views. A
constant picture has no differences at all: so the contrast stands beside them.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.errors import NotApplicableError
from sucre_bench.imaging.cielab import ciede2000, contrast, lab_d50
from sucre_bench.plugins.decorators import metric
from sucre_bench.restored_pair import RestoredPair
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
                raise NotApplicableError("all points of a view have one colour; nothing to relate differences to")
            yield Score(float(differences.sum()) / total, n_pixels=n, coverage=share, weight=total)
            return
        yield Score(float(differences.mean()), n_pixels=n, coverage=share, weight=n)
        change = np.abs(np.diff(pair.points.distance, axis=0)[0])[known]
        for low, high in zip((0.0, *_STEPS[:-1]), _STEPS, strict=True):
            inside = (change >= low) & (change < high)
            count = int(inside.sum())
            if count >= _FEWEST:
                yield Score(float(differences[inside].mean()), f"image/{low:g}-{high:g} m", count, share, weight=count)


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
        yield Score((contrast(here) + contrast(there)) / 2, n_pixels=n, coverage=share, weight=n)


def _lab(pair: RestoredPair) -> tuple[Array, Array, Mask]:
    """CIE Lab (K, 3) of the patches that have a colour in both views, in each; and which of all these are (P,).

    Raises NotApplicableError if they are fewer than five.
    """
    here, there = pair.means(pair.here.shown, pair.there.shown)
    known = np.asarray(np.isfinite(here).all(axis=1))
    if known.sum() < _FEWEST:
        raise NotApplicableError(f"the two views have fewer than {_FEWEST} patches with colours in common")
    return lab_d50(here[known]), lab_d50(there[known]), known
