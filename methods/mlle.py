"""Minimal colour loss and locally adaptive contrast enhancement, MLLE.

Zhang, Zhuang, Sun, Li, Kwong & Li 2022, Underwater image enhancement via minimal color loss and locally adaptive
contrast enhancement, IEEE TIP 31. Written from the publication's method. Its authors' program is compiled and was not
read. docs/methods.md says which reading of each step is taken, and how near the result is to the authors'.
"""

from dataclasses import dataclass

import numpy as np

from sucre_bench import Restoration, Scene, View, method
from sucre_bench.arrays import Array
from sucre_bench.imaging.cielab import from_lab, to_lab
from sucre_bench.imaging.display import stretch
from sucre_bench.imaging.filters import box_mean, stretched_together
from sucre_bench.plugins.options import check_ranges

_DETAIL_PX = 1.0  # standard deviation of the Gaussian that separates detail; not published
_ZERO = 128.0  # gray's a and b in 8 bits, in which the publication's means are positive


@method(
    requires=("cv2",),
    cites="Zhang, Zhuang, Sun, Li, Kwong & Li 2022, IEEE TIP (MLLE)",
    encoding="gamma",
)
@dataclass(frozen=True)
class Mlle:
    """Balance weak channels, then raise the contrast of lightness block by block.

    The corrected channels replace the photograph most where one of its channels is dark. Each pixel's lightness moves
    away from the mean of its block, more in smooth blocks than in rough ones.
    """

    gamma: float = 1.2
    """Exponent of the attenuation map 1 - min(R, G, B)^gamma: the share of the corrected colours at each pixel."""

    block_px: int = 25
    """Side of the block around each pixel whose mean and variance are taken, pixels, odd."""

    contrast: float = 2.0
    """Greatest gain of a block's contrast (beta); 1 never raises it."""

    percent: float = 1.0
    """Percent of the pixels whose lightness becomes 0, and as many 100; 0 stretches from minimum to maximum."""

    def __post_init__(self) -> None:
        check_ranges(
            self, gamma="(0, 10]", block_px="[3, 1001]", contrast="(0, 100]", percent="[0, 50)"
        )

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image, in [0, 1]."""
        lab = to_lab(corrected(view.rgb, self.gamma))
        light = enhanced_lightness(lab[..., 0] / 100, self.block_px, self.contrast)
        lab[..., 0] = 100 * stretched_together(light, self.percent)
        lab[..., 1:] = balanced_chroma(lab[..., 1:])
        return Restoration(from_lab(lab))


def corrected(rgb: Array, gamma: float) -> Array:
    """Return D + A C + (1 - A) I: detail D, attenuation map A = 1 - min(R, G, B)^gamma, colour transfer image C.

    rgb: (H, W, 3) float32 in [0, 1]; the result may leave [0, 1].
    """
    import cv2

    # the greatest of the three channels'
    attenuation = 1 - rgb.min(axis=-1, keepdims=True) ** np.float32(gamma)
    detail = rgb - cv2.GaussianBlur(rgb, (0, 0), _DETAIL_PX)
    return detail + attenuation * colour_transfer(rgb) + (1 - attenuation) * rgb


def colour_transfer(rgb: Array) -> Array:
    """Return the image with equal channel means, each channel then stretched from its minimum and maximum to [0, 1].

    The strongest channel I_l is added to the others, I_c + (mean I_l - mean I_c) I_l, until the means agree. The limit
    of these steps is I_c + (1 - mean I_c / mean I_l) I_l, which is computed at once.
    """
    mean = rgb.mean(axis=(0, 1), dtype=np.float64)
    strongest = int(mean.argmax())
    share = 1 - mean / max(mean[strongest], 1e-6)
    even = rgb + share.astype(np.float32) * rgb[..., strongest, None]
    return stretch(even, 0, 100).astype(np.float32)


def enhanced_lightness(light: Array, block_px: int, contrast: float) -> Array:
    """Return m + min(V / v, contrast) (L - m) for lightness L (H, W).

    m and v are the mean and variance of the block around each pixel, cut at the border; V is the image's variance.
    """
    mean = box_mean(light, block_px // 2)
    variance = np.maximum(
        box_mean(light * light, block_px // 2) - mean * mean, np.float32(1e-8)
    )
    gain = np.minimum(np.float32(light.var(dtype=np.float64)) / variance, np.float32(contrast))
    return mean + gain * (light - mean)


def balanced_chroma(chroma: Array) -> Array:
    """Return a and b (H, W, 2) of CIE L*a*b*, the one of the lower mean x raised: x (1 + (y - x) / (y + x)).

    The means x and y, and the product, count from 128 below gray, as in 8-bit L*a*b*.
    """
    a, b = (chroma.mean(axis=(0, 1), dtype=np.float64) + _ZERO).tolist()
    gain = np.array(
        [1 + max(0.0, b - a) / (a + b), 1 + max(0.0, a - b) / (a + b)], dtype=np.float32
    )
    return (chroma + np.float32(_ZERO)) * gain - np.float32(_ZERO)
