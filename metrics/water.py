"""The estimated water: its relative error where the truth is known (made scenes), and its parameters.

In the sea the parameters are the same in all views (SUCRe, appendix).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import CHANNELS, Array
from sucre_bench.errors import NotApplicableError
from sucre_bench.plugins.plugin import metric
from sucre_bench.scene import Restoration, Score, View, Water as TrueWater

_MEANINGS = {
    "veiling_light": "B, in the intensities that the method explains",
    "attenuation": "beta, 1/m",
    "backscatter": "gamma, 1/m",
}
_VARIANTS = {
    f"{name}-{channel}": meaning for name, meaning in _MEANINGS.items() for channel in CHANNELS
}


@metric(
    role="water-parameters",
    needs={"restoration"},
    unit="",
    better="none",
    range=(-np.inf, np.inf),
    default=list(_VARIANTS),
    cites="Boittiaux et al. 2024",
    variants=_VARIANTS,
)
@dataclass(frozen=True)
class WaterParameters:
    """Estimated parameters of the water, a channel a variant; nothing where a method estimates none."""

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield one score, NaN for a parameter that is not estimated."""
        if restored.water is None:
            return
        name, _, channel = variant.partition("-")
        value = float(getattr(restored.water, name)[CHANNELS.index(channel)])
        yield Score(
            value, n_pixels=int(restored.valid.sum()), coverage=float(restored.valid.mean())
        )


@metric(
    role="diagnosis",
    needs={"truth"},
    unit="relative",
    better="lower",
    range=(0, np.inf),
    default=["attenuation", "backscatter", "veiling_light"],
    variants={
        "attenuation": "of beta, 1/m",
        "backscatter": "of gamma, 1/m",
        "veiling_light": "of B",
    },
)
@dataclass(frozen=True)
class Water:
    """Relative error of the estimated water, |estimate - truth| / truth: the mean of the channels, and each channel.

    The true water is `restored.info["true_water"]`, a `scene.Water`, which the engine puts there after the method has
    run. A channel whose true value is 0 has no relative error: NaN, and the mean goes without it. A parameter that a
    method does not estimate is NaN in its water, and has no score. A water of another encoding than the true one has no
    score either.
    """

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield a score for the image and one per channel; nothing where the method estimates no water.

        Raises NotApplicableError where estimate and truth explain intensities of different encoding.
        """
        truth: TrueWater | None = restored.info.get("true_water")
        if restored.water is None or truth is None:
            return
        if (explained := restored.water.encoding) != truth.encoding:
            fault = f"the estimate explains {explained or 'the view'}, the true water {truth.encoding or 'the view'}"
            raise NotApplicableError(
                f"{view.name}: {fault} intensities, which cannot be compared"
            )
        estimate = np.asarray(getattr(restored.water, variant), dtype=np.float64)
        if np.isnan(estimate).all():
            return
        true = np.asarray(getattr(truth, variant), dtype=np.float64)
        error = np.abs(estimate - true) / np.where(true > 0, true, np.nan)
        n, coverage = int(restored.valid.sum()), float(restored.valid.mean())
        known = error[true > 0]
        yield Score(float(known.mean()) if known.size else np.nan, "image", n, coverage)
        for channel, value in zip(CHANNELS, error, strict=True):
            yield Score(float(value), f"image/{channel}", n, coverage)
