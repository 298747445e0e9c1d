"""UCIQE, a quality measure without a reference: chroma, contrast and saturation in CIE Lab.

Source: Yang & Sowmya 2015, "An underwater color image quality evaluation metric", IEEE TIP 24(12):

    UCIQE = .4680 sigma_c + .2745 con_l + .2576 mu_s

sigma_c: spread of the chroma c = |(a, b)|; con_l: luminance at its top less at its bottom 1 %; mu_s: mean saturation.
The publication fixes neither the scale of Lab nor the saturation's formula, so public programs give anything from .3
to 40 for one picture. The published values lie in 0 to 1. "yang2015", the default, is the widely shared program with
OpenCV's Lab (white D65). "matlab" is the same with MATLAB's Lab (white D50), and reproduces the scores that U45
publishes within .0001. astronaut / coffee of scikit-image: yang2015 .688 / .663, matlab .691 / .665, ratio 2.12 / 1.41,
cielab 38.4 / 35.5, hsv 38.5 / 36.5, hue .520 / .474, centred .404 / .420.

All variants see the picture as 8-bit sRGB; pixels without a colour are left out of every term. Sums run over the
picture's palette: each colour once, times how often it occurs.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import AnyArray, Array, locked, once
from sucre_bench.imaging.cielab import lab_d50_of_linear
from sucre_bench.imaging.encoding import Palette, eight_bit, palette, srgb_decode
from sucre_bench.imaging.percentiles import ValueCounts
from sucre_bench.plugins.plugin import metric
from sucre_bench.scene import Restoration, Score, View

_VARIANTS = {
    "yang2015": "8-bit Lab / 255 with the offset 128 kept, sigma_c = sqrt(mean |1 - (mean c / c)^2|),"
    " s = c / sqrt(c^2 + L^2), as in UCIQE.m (bilityniu/underwater_image_fusion and others), with OpenCV's Lab (D65)",
    "matlab": "as yang2015, with MATLAB's Lab (D50) and the levels of its stretchlim: the scores U45 publishes",
    "range-contrast": "as yang2015, con_l relative to the picture's own range of L, as in JOU-UIP/UCIQE's UCIQE.py",
    "ratio": "8-bit Lab / 255 with the offset kept, sigma_c the standard deviation, s = c / L, as in"
    " TongJiayan/UCIQE-python",
    "centred": "8-bit Lab / 255 with a and b less .5, sigma_c the standard deviation, con_l from the least to the"
    " greatest L, s = c / sqrt(c^2 + L^2), as in Jinxinshao/UIEAnything",
    "cielab": "CIE Lab unscaled, con_l between the means of the top and bottom 1 %, s = c / L, as in"
    " xueleichen/PSNR-SSIM-UCIQE-UIQM-Python since June 2022",
    "cielab-range": "as cielab, con_l from the least to the greatest L, as in paulwong16/UCIQE",
    "hsv": "CIE Lab unscaled, con_l from the least to the greatest L, s of HSV, as in"
    " bilityniu/underimage-fusion-enhancement",
    "strided": "as cielab, but con_l between the means of every hundredth part of L sorted up and down, so about 0,"
    " as in xueleichen/PSNR-SSIM-UCIQE-UIQM-Python until June 2022, and copies of it",
    "hue": "no Lab: standard deviation of the hue / 180 deg, V of HSV between the means of its top and bottom 1 %,"
    " S of HSV, as in CXH-Research/Pytorch-UW-IQA and GuidedHybSensUIR",
    "hue-bgr": "as hue, red and blue exchanged, mu_s weighs .2575, as in MelodyZhangZH/UWCNN-plus",
    "hsv-bytes": "no Lab: H, S, V as OpenCV's bytes, standard deviation of H, mean V of its top 1 % less nothing,"
    " mean S, as in Owen718/Image-quality-measure-method's UCIQE.py",
}


@metric(
    role="no-reference",
    requires=["cv2", "numba", "skimage"],
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

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield one score, NaN where the picture has no colour at all."""
        shown = locked(shown)
        picture = eight_bit(shown)
        value = uciqe(shown, variant) if picture.n_valid else np.nan
        yield Score(
            value, n_pixels=picture.n_valid, coverage=picture.n_valid / picture.valid.size
        )


def uciqe(shown: AnyArray, variant: str = "yang2015") -> float:
    """Return UCIQE of a picture (H, W, 3) in [0, 1], some of it with a colour (Yang & Sowmya 2015).

    variant: one of the metric's.
    """
    if variant in ("hue", "hue-bgr", "hsv-bytes"):
        return _of_hsv(palette(shown), variant)
    space: Space = "bytes" if variant in _IN_BYTES else "cie"
    if variant == "matlab":
        space = "d50"
    L, a, b = _lab(shown, space)
    if variant == "centred":
        a, b = a - 0.5, b - 0.5
    c = np.hypot(a, b)
    counts = palette(shown).counts
    sigma = _deviation(c, counts)
    if variant in (
        "yang2015",
        "range-contrast",
        "matlab",
    ):
        # the offset that these keep makes c > 0
        sigma = float(np.sqrt(_mean(np.abs(1 - (_mean(c, counts) / c) ** 2), counts)))
    if variant == "hsv":
        rgb = palette(shown).rgb
        top, bottom = rgb.max(axis=-1).astype(float), rgb.min(axis=-1)
        s = (top - bottom) / np.where(top > 0, top, np.inf)
    elif variant in ("ratio", "cielab", "cielab-range", "strided"):
        s = c / np.where(L > 0, L, np.inf)  # black is without saturation
    else:
        s = c / np.where(c > 0, np.hypot(c, L), np.inf)
    return _weigh(sigma, _contrast(_lightness(shown, space), variant), _mean(s, counts))


def _of_hsv(colours: Palette, variant: str) -> float:
    """The variants without Lab. OpenCV's bytes: H in steps of 2 degrees, S and V of 255."""
    import cv2

    rgb = np.ascontiguousarray(colours.rgb[:, ::-1] if variant == "hue-bgr" else colours.rgb)
    H, S, V = cv2.cvtColor(rgb.reshape(-1, 1, 3), cv2.COLOR_RGB2HSV).reshape(-1, 3).T
    value = ValueCounts.of(V, colours.counts)
    counts = colours.counts
    n = max(value.size // 100, 1)
    if variant == "hsv-bytes":
        return _weigh(_deviation(H, counts), value.mean(value.size - n), _mean(S, counts))
    contrast = (value.mean(value.size - n) - value.mean(0, n)) / 255
    saturation_weight = 0.2575 if variant == "hue-bgr" else 0.2576
    return _weigh(
        _deviation(H, counts) / 180, contrast, _mean(S, counts) / 255, saturation_weight
    )


def _weigh(sigma_c: float, con_l: float, mu_s: float, saturation: float = 0.2576) -> float:
    return float(0.4680 * sigma_c + 0.2745 * con_l + saturation * mu_s)


# -- spread and contrast -------------------------------------------------------------------------------------


def _mean(x: AnyArray, counts: npt.NDArray[np.int64]) -> float:
    return float((x * counts).sum() / counts.sum())


def _deviation(c: AnyArray, counts: npt.NDArray[np.int64]) -> float:
    return float(np.sqrt(_mean((c - _mean(c, counts)) ** 2, counts)))


def _contrast(L: ValueCounts, variant: str) -> float:
    """con_l, of the lightness of all pixels."""
    whole = float(L.values[-1] - L.values[0])
    if variant in ("centred", "cielab-range", "hsv"):
        return whole
    if variant == "matlab":
        # the least level with more than 1 % of the pixels up to it, and with at least 99 % of them
        share = L.upto / L.size
        return float(L.values[np.argmax(share >= 0.99)] - L.values[np.argmax(share > 0.01)])
    n = max(round(0.01 * L.size), 1)
    if variant == "cielab":
        return L.mean(L.size - n) - L.mean(0, n)
    if variant == "strided":
        return float(
            L.at(np.arange(L.size - 1, -1, -n)).mean() - L.at(np.arange(0, L.size, n)).mean()
        )
    percentiles = L.percentile(99) - L.percentile(1)
    return percentiles / max(whole, 1e-9) if variant == "range-contrast" else percentiles


# -- colour spaces -------------------------------------------------------------------------------------------

# "bytes": as OpenCV and MATLAB store Lab in 8-bit images, L 255 / 100, a + 128, b + 128, over 255, under D65; "d50":
# the same under D50, sRGB brought there from D65 by Bradford's transform, as colour profiles (ICC) have it; "cie": CIE
# Lab under D65.
Space = Literal["bytes", "d50", "cie"]
_IN_BYTES = ("yang2015", "range-contrast", "ratio", "centred")


@once
def _lab(shown: AnyArray, space: Space) -> Array:
    """L, a, b (3, U) float64 of the picture's colours."""
    rgb = palette(shown).rgb
    if space == "bytes":
        import cv2

        return np.asarray(
            cv2.cvtColor(rgb.reshape(-1, 1, 3), cv2.COLOR_RGB2LAB).reshape(-1, 3).T
            / np.float64(255)
        )
    if space == "d50":
        L, a, b = lab_d50_of_linear(srgb_decode(np.arange(256) / 255)[rgb]).T
        return np.asarray(
            np.floor(np.stack([L * 2.55, a + 128, b + 128]) + 0.5).clip(0, 255) / 255
        )
    from skimage.color import rgb2lab

    return np.asarray(rgb2lab(rgb.reshape(-1, 1, 3)).reshape(-1, 3).T)


@once
def _lightness(shown: AnyArray, space: Space) -> ValueCounts:
    L = _lab(shown, space)[0]
    counts = palette(shown).counts
    if space == "cie":
        return ValueCounts.of(L, counts)
    of_level = np.bincount(np.rint(L * 255).astype(np.intp), weights=counts)
    levels = np.flatnonzero(of_level)
    return ValueCounts.of(levels / 255, of_level[levels].astype(np.int64))
