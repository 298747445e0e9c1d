"""Underwater light attenuation prior, ULAP (Song et al. 2018, A rapid scene depth estimation model).

Water takes red first. So depth is modelled as linear in red and in the stronger of green and blue. The authors learned
the coefficients from images of known relative depth.
"""

from dataclasses import dataclass

import numpy as np

from sucre_bench import InputError, Restoration, Scene, View, method
from sucre_bench.arrays import Array
from sucre_bench.imaging.filters import guided_filter
from sucre_bench.imaging.image_formation import (
    brightest,
    highest,
    nearest_depth,
    restoration,
    stretched_plane,
)
from sucre_bench.plugins.options import check_ranges

# learned, for intensities in [0, 1]
_OFFSET = 0.51157954
_STRONGER = 0.50516165
_RED = -0.90511117


@method(
    requires=("cv2",),
    encoding="gamma",
    cites="Song, Wang, Huang & Tjondronegoro 2018, A rapid scene depth estimation model based on underwater light "
    "attenuation prior for underwater image restoration",
)
@dataclass(frozen=True)
class Ulap:
    """Estimate depth linearly from red and the stronger of green and blue, and undo the attenuation over it.

    Depth is stretched to [0, 1] and refined by a guided filter. The veiling light A is the brightest of the deepest
    pixels. Then J = (I - A) / t + A with t = r^(deepest (depth + nearest)); r is the share of light left after a metre.
    """

    remaining: tuple[float, ...] = (0.83, 0.95, 0.97)
    """Shares of red, green and blue light that remain after one metre."""
    deepest: float = 8.0
    """Distance of relative depth 1, metres."""
    share: float = 0.001
    """Share of the deepest pixels; the brightest of them gives the veiling light."""
    radius: int = 50
    """Radius of the guided filter's window, pixels."""
    eps: float = 1e-3
    """Variance of intensity below which the guided filter smooths."""
    least: float = 0.1
    """Least transmission: noise is amplified by at most 1 / least; 1e-6 switches the bound off."""
    greatest: float = 0.9
    """Greatest transmission; 1 switches the bound off."""

    def __post_init__(self) -> None:
        check_ranges(self, remaining="[1e-3, 1]", deepest="(0, 1000]", share="(0, 1]")
        check_ranges(
            self,
            radius="[1, 1000]",
            eps="[1e-6, 1]",
            least="[1e-6, 1]",
            greatest=f"[{self.least}, 1]",
        )
        if len(self.remaining) != 3:
            raise InputError(
                f"ulap.remaining: {self.remaining} is not three numbers; give red's, green's and blue's"
            )

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image; values may leave [0, 1]."""
        rgb = view.rgb
        depth = guided_filter(rgb, stretched_plane(depth_prior(rgb)), self.radius, self.eps)
        A = brightest(rgb, highest(depth, self.share))
        metres = self.deepest * (depth.clip(0, 1) + np.float32(nearest_depth(rgb, A)))
        t = np.array(self.remaining, dtype=np.float32) ** metres[..., None]
        return restoration(rgb, A, t.clip(self.least, self.greatest))


def depth_prior(rgb: Array) -> Array:
    """Return the depth prior (H, W) before it is stretched: linear in red and in the stronger of green and blue."""
    stronger = rgb[..., 1:].max(axis=-1)
    return np.asarray(_OFFSET + _STRONGER * stronger + _RED * rgb[..., 0])
