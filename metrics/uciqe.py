"""UCIQE, a quality measure without a reference: chroma, contrast and saturation in CIE Lab.

Source: Yang & Sowmya 2015, "An underwater color image quality evaluation metric", IEEE TIP 24(12):

    UCIQE = .4680 sigma_c + .2745 con_l + .2576 mu_s

sigma_c: spread of the chroma c = |(a, b)|; con_l: luminance at its top less at its bottom 1 %; mu_s: mean saturation.
The publication fixes neither the scale of Lab nor the saturation's formula, so programs in use give anything from .3
to 40 for one picture. Its printed values lie in 0 to 1, which of the public forms only the widely shared MATLAB program
keeps to: that one is the default here ("yang2015"), with its peculiarities (below). A value means something only beside
values of the same variant. astronaut / coffee of scikit-image: yang2015 .688 / .663, ratio 2.12 / 1.41,
cielab 38.4 / 35.5, hsv 38.5 / 36.5, strided 11.2 / 9.5.

All variants see the picture as 8-bit sRGB; pixels without a colour are left out of every term.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array
from sucre_bench.imaging.encoding import to_8bit
from sucre_bench.plugins.decorators import metric
from sucre_bench.scene import Restoration, Score, View

__all__ = ["Uciqe", "uciqe"]

_VARIANTS = {
    "yang2015": "8-bit Lab / 255 with the offset 128 kept, sigma_c = sqrt(mean |1 - (mean c / c)^2|),"
    " s = c / sqrt(c^2 + L^2), as in UCIQE.m (bilityniu/underwater_image_fusion and others)",
    "range-contrast": "as yang2015, con_l relative to the picture's own range of L, as in JOU-UIP/UCIQE",
    "ratio": "8-bit Lab / 255 with the offset kept, sigma_c the standard deviation, s = c / L, as in"
    " TongJiayan/UCIQE-python",
    "cielab": "CIE Lab unscaled, con_l between the means of the top and bottom 1 %, s = c / L",
    "hsv": "CIE Lab unscaled, con_l from the least to the greatest L, s of HSV, as in"
    " bilityniu/underimage-fusion-enhancement",
    "strided": "as cielab, but con_l between the means of every hundredth part of L sorted up and down, hence about 0,"
    " as in xueleichen/PSNR-SSIM-UCIQE-UIQM-Python",
}


@metric(
    requires=["cv2", "skimage"],
    unit="",
    better="higher",
    range=(0, np.inf),
    cites="Yang & Sowmya 2015",
    variants=_VARIANTS,
)
@dataclass(frozen=True)
class Uciqe:
    """Underwater colour image quality evaluation: spread of chroma, contrast and saturation, without a reference.

    It rewards vivid pictures, right or wrong: it hardly follows PSNR (SUCRe, table 1).
    """

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterator[Score]:
        """Yield one score, NaN where the picture has no colour at all."""
        valid = np.isfinite(shown).all(axis=-1)
        value = uciqe(to_8bit(shown[valid]), variant) if valid.any() else np.nan
        yield Score(value, n_pixels=int(valid.sum()), coverage=float(valid.mean()))


def uciqe(pixels: npt.NDArray[np.uint8], variant: str = "yang2015") -> float:
    """Return UCIQE of sRGB pixels (P, 3) uint8, P > 0, by one of the metric's variants (Yang & Sowmya 2015)."""
    if variant in ("yang2015", "range-contrast", "ratio"):
        L, a, b = _lab_8bit(pixels)
    else:
        L, a, b = _lab(pixels)
    c = np.hypot(a, b)
    s = c / np.where(L > 0, L, np.inf)  # black is without saturation
    if variant == "yang2015":
        return _weigh(_relative_spread(c), _percentile_contrast(L), _share_of_chroma(c, L))
    if variant == "range-contrast":
        con_l = _percentile_contrast(L) / max(float(np.ptp(L)), 1e-9)
        return _weigh(_relative_spread(c), con_l, _share_of_chroma(c, L))
    if variant == "ratio":
        return _weigh(c.std(), _percentile_contrast(L), s.mean())
    n = max(round(0.01 * L.size), 1)
    L = np.sort(L)
    if variant == "cielab":
        return _weigh(c.std(), L[-n:].mean() - L[:n].mean(), s.mean())
    if variant == "strided":
        return _weigh(c.std(), L[::-1][::n].mean() - L[::n].mean(), s.mean())
    top, bottom = pixels.max(axis=-1).astype(float), pixels.min(axis=-1).astype(float)
    hsv_saturation = (top - bottom) / np.where(top > 0, top, np.inf)
    return _weigh(c.std(), L[-1] - L[0], hsv_saturation.mean())


def _weigh(sigma_c: float, con_l: float, mu_s: float) -> float:
    return float(0.4680 * sigma_c + 0.2745 * con_l + 0.2576 * mu_s)


def _relative_spread(c: Array) -> float:
    return float(np.sqrt(np.abs(1 - (c.mean() / c) ** 2).mean()))  # the kept offset makes c > 0


def _share_of_chroma(c: Array, L: Array) -> float:
    return float((c / np.hypot(c, L)).mean())


def _percentile_contrast(L: Array) -> float:
    bottom, top = np.percentile(L, [1, 99])
    return float(top - bottom)


def _lab_8bit(pixels: npt.NDArray[np.uint8]) -> npt.NDArray[Any]:
    """L, a, b (3, P) of 8-bit images as OpenCV and MATLAB store them, L 255 / 100, a + 128, b + 128; over 255."""
    import cv2

    lab = cv2.cvtColor(pixels.reshape(-1, 1, 3), cv2.COLOR_RGB2LAB)
    return lab.reshape(-1, 3).T / np.float64(255)


def _lab(pixels: npt.NDArray[np.uint8]) -> npt.NDArray[Any]:
    """L, a, b (3, P), CIE Lab under D65."""
    from skimage.color import rgb2lab

    return np.asarray(rgb2lab(pixels.reshape(-1, 1, 3))).reshape(-1, 3).T
