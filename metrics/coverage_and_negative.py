"""Coverage, the share of pixels that have a colour, and negative, the share of pixels with impossible ones."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array, coloured_pixels
from sucre_bench.plugins.decorators import metric
from sucre_bench.scene import Restoration, Score, View

_CHANNELS = {"red": 0, "green": 1, "blue": 2}


@metric(
    role="coverage",
    needs={"restoration"},
    unit="share",
    better="higher",
    range=(0, 1),
    variants={"image": "of all pixels of the image", "depth": "of the pixels with depth; nothing without a depth map"},
)
@dataclass(frozen=True)
class Coverage:
    """Share of pixels that have a colour."""

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterator[Score]:
        """Yield one score, NaN where there is no pixel to cover; its n_pixels and coverage are those looked at."""
        if variant == "depth" and not view.has_depth:
            return
        given = coloured_pixels(restored.image)
        asked = view.depth > 0 if variant == "depth" else np.ones_like(given)
        value = float(given[asked].mean()) if asked.any() else np.nan
        yield Score(value, n_pixels=int(asked.sum()), coverage=float(asked.mean()))


@metric(
    role="negative",
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

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterator[Score]:
        """Yield one score, NaN where no pixel has a colour."""
        valid = coloured_pixels(restored.image)
        channels = range(3) if variant == "any" else [_CHANNELS[variant]]
        negative = np.zeros_like(valid)
        for channel in channels:
            negative |= restored.image[..., channel] < 0
        n = int(np.count_nonzero(valid))
        value = np.count_nonzero(negative & valid) / n if n else np.nan
        yield Score(value, n_pixels=n, coverage=float(valid.mean()))
