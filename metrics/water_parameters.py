"""The estimated water, to see whether it is the same in all views, as in the sea (SUCRe, appendix)."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.plugins.decorators import metric
from sucre_bench.scene import Restoration, Score, View

_CHANNELS = ("red", "green", "blue")
_PARAMETERS = {
    "veiling_light": "B, in the intensities that the method explains",
    "attenuation": "beta, 1/m",
    "backscatter": "gamma, 1/m",
}
_VARIANTS = {f"{name}-{channel}": says for name, says in _PARAMETERS.items() for channel in _CHANNELS}


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

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterator[Score]:
        """Yield one score, NaN for a parameter that is not estimated."""
        if restored.water is None:
            return
        name, _, channel = variant.partition("-")
        value = float(getattr(restored.water, name)[_CHANNELS.index(channel)])
        yield Score(value, n_pixels=int(restored.valid.sum()), coverage=float(restored.valid.mean()))
