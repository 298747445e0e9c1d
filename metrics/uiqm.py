"""UIQM, a quality measure without a reference: colourfulness, sharpness and contrast.

Source: Panetta, Gao & Agaian 2016, "Human-visual-system-inspired underwater image quality measures", IEEE JOE 41(3):

    UIQM   = .0282 UICM + .2953 UISM + 3.5753 UIConM
    UICM   = -.0268 sqrt(mu_RG^2 + mu_YB^2) + .1586 sqrt(var_RG + var_YB),  RG = R - G,  YB = (R + G) / 2 - B,
             mu: mean without the lowest and highest tenth; var: about mu, over all pixels
    UISM   = .299 EME(R') + .587 EME(G') + .114 EME(B'),  C' = C Sobel(C),  EME = 2 / (k1 k2) sum ln(max / min)
    UIConM = logAMEE of the intensity = 1 / (k1 k2) (x) sum m ln m,  m = (max (-) min) / (max (+) min),

sums over k1 k2 blocks, (+) (-) (x) the operations of parameterised logarithmic image processing (PLIP), whose
constants gamma and k are 1026. Where readers of the publication differ, the default takes: blocks of 10x10 pixels,
incomplete ones dropped; a block whose least value is 0 adds nothing to an EME; the intensity is the luma
.299/.587/.114; the sum is PLIP's too, so that logAMEE is a mean whatever the image's size (with a plain sum the factor
(x) makes it vanish as the image grows); the sign of every m ln m is turned, as all are negative and the published
values positive. A scale of the Sobel filter cancels in max / min. -m ln m is greatest at m = .37: blocks of full
contrast count for less again. Each variant differs from the default in exactly what its description says; "funie" and
"chen" are the two programs most in use. astronaut / coffee of scikit-image: panetta2016 2.54 / 2.93, funie 2.41 / 2.52,
chen .94 / .64.

All see the picture as 8-bit sRGB. A block counts where every pixel of it, and for EME every neighbour, has a colour.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array, Mask
from sucre_bench.imaging.encoding import to_8bit
from sucre_bench.plugins.decorators import metric
from sucre_bench.scene import Restoration, Score, View

__all__ = ["Recipe", "Uiqm", "alpha_trimmed_mean", "eme", "uicm", "uiconm", "uism"]

Image = npt.NDArray[np.uint8]
_PLIP = 1026.0  # gamma and k
_LUMA = (0.299, 0.587, 0.114)


@dataclass(frozen=True, slots=True)
class Recipe:
    """The points on which implementations differ.

    trimmed_variance: var over the pixels mu is made of; blue: the weight of EME(B'); block: its side, pixels;
    partial_blocks: whether blocks cut by the image's edge count; zero_is_one: ln(max / 1) for blocks that hold a 0,
    in place of nothing; rounded_edges: C' of C / 255 in Sobel, to the nearest integer; wraparound: R - G and R + G
    modulo 256, as unsigned bytes do; contrast: "plip", "plip-unit" (of Rec. 709 luma in [0, 1], the sum plain,
    the sign as printed), "plain" (ordinary - and + in place of PLIP), "channels" (plain, over the three channels).
    """

    trimmed_variance: bool = False
    blue: float = _LUMA[2]
    block: int = 10
    partial_blocks: bool = False
    zero_is_one: bool = False
    rounded_edges: bool = False
    wraparound: bool = False
    contrast: Literal["plip", "plip-unit", "plain", "channels"] = "plip"


PANETTA = Recipe()
_VARIANTS = {
    "panetta2016": ("as published, see the module", PANETTA),
    "trimmed-variance": ("variances over the trimmed pixels", replace(PANETTA, trimmed_variance=True)),
    "blue144": ("EME(B') weighs .144, a misprint often copied", replace(PANETTA, blue=0.144)),
    "block8": ("blocks of 8x8 pixels", replace(PANETTA, block=8)),
    "block5": ("blocks of 5x5 pixels", replace(PANETTA, block=5)),
    "no-plip": ("ordinary arithmetic in UIConM", replace(PANETTA, contrast="plain")),
    "plus-one": ("blocks with a 0 count as ln(max / 1) in UISM", replace(PANETTA, zero_is_one=True)),
    "wraparound": ("R - G and R + G modulo 256, as unsigned bytes do", replace(PANETTA, wraparound=True)),
    "funie": (
        "as in xahidbuffon/FUnIE-GAN, the port most copied: blue144, UIConM without PLIP over the three channels",
        replace(PANETTA, blue=0.144, contrast="channels"),
    ),
    "chen": (
        "as in xueleichen/PSNR-SSIM-UCIQE-UIQM-Python: trimmed-variance, block8 with partial blocks, plus-one,"
        " wraparound, edges rounded, UIConM of luma in [0, 1] with a plain sum, negative and near 0",
        Recipe(True, _LUMA[2], 8, True, True, True, True, "plip-unit"),
    ),
}


@metric(
    requires=["cv2"],
    unit="",
    better="higher",
    range=(-np.inf, np.inf),
    cites="Panetta, Gao & Agaian 2016",
    variants={name: about for name, (about, _) in _VARIANTS.items()},
)
@dataclass(frozen=True)
class Uiqm:
    """Underwater image quality measure: colourfulness, sharpness and contrast, without a reference.

    It rewards noise and vivid colours, right or wrong: it hardly follows PSNR (SUCRe, table 1).
    """

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterator[Score]:
        """Yield one score, NaN where no block is whole; coverage is the share of the blocks that UISM is made of."""
        recipe = _VARIANTS[variant][1]
        valid = np.asarray(np.isfinite(shown).all(axis=-1))
        whole = _whole(_with_neighbours(valid), recipe)
        if not whole.any():
            yield Score(np.nan, n_pixels=0, coverage=0.0)
            return
        image = to_8bit(shown)
        colour, contrast = uicm(image[valid], recipe), uiconm(image, valid, recipe)
        value = 0.0282 * colour + 0.2953 * uism(image, valid, recipe) + 3.5753 * contrast
        yield Score(value, n_pixels=int(valid.sum()), coverage=float(whole.mean()))


def uicm(pixels: Image, recipe: Recipe = PANETTA) -> float:
    """Return the colourfulness of sRGB pixels (P, 3) uint8, P > 0."""
    R, G, B = pixels.T if recipe.wraparound else pixels.T.astype(np.int16)
    mean_RG, var_RG = _trimmed(R - G, recipe)
    mean_YB, var_YB = _trimmed((R + G) / 2 - B, recipe)
    return float(-0.0268 * np.hypot(mean_RG, mean_YB) + 0.1586 * np.sqrt(var_RG + var_YB))


def _trimmed(x: npt.NDArray[Any], recipe: Recipe) -> tuple[float, float]:
    """Mean and variance of the opponent colour x (P,)."""
    kept = _without_tails(x)
    mean = kept.mean(dtype=np.float64)
    return mean, np.mean(((kept if recipe.trimmed_variance else x) - mean) ** 2, dtype=np.float64)


def alpha_trimmed_mean(x: npt.NDArray[Any], alpha: float = 0.1) -> float:
    """Return the mean of x (P,) without its ceil(alpha P) lowest and floor(alpha P) highest values."""
    return float(_without_tails(x, alpha).mean(dtype=np.float64))


def _without_tails(x: npt.NDArray[Any], alpha: float = 0.1) -> npt.NDArray[Any]:
    low, high = int(np.ceil(alpha * x.size)), int(np.floor(alpha * x.size))
    return np.sort(x)[low : x.size - high]


def uism(image: Image, valid: Mask, recipe: Recipe = PANETTA) -> float:
    """Return the sharpness of an image (H, W, 3) uint8 over the blocks whose pixels and neighbours are valid (H, W)."""
    import cv2

    whole = _whole(_with_neighbours(valid), recipe)
    total = 0.0
    for channel, weight in enumerate((*_LUMA[:2], recipe.blue)):
        plane = np.ascontiguousarray(image[..., channel]).astype(np.float32)
        dx, dy = (cv2.Sobel(plane, -1, i, 1 - i, borderType=cv2.BORDER_REFLECT) for i in (1, 0))
        edges = plane * np.hypot(dx, dy)
        if recipe.rounded_edges:  # the filter as scikit-image scales it: steps of 1 give 1, two directions averaged
            edges = np.round(edges / np.float64(4 * 255 * np.sqrt(2)))
        total += weight * eme(edges, whole, recipe)
    return total


def eme(plane: Array, whole: Mask, recipe: Recipe = PANETTA) -> float:
    """Return 2 x the mean of ln(max / min) over the blocks of a plane (H, W) >= 0 that are whole (k1, k2)."""
    least, most = (x.astype(np.float64) for x in _extremes(plane, whole, recipe))
    if recipe.zero_is_one:
        least, most = np.where(least == 0, 1, least), np.where(most == 0, 1, most)
    usable = least > 0
    ratio = np.log(most[usable] / least[usable])
    return float(2 * ratio.sum() / least.size)


def uiconm(image: Image, valid: Mask, recipe: Recipe = PANETTA) -> float:
    """Return the contrast of an image (H, W, 3) uint8 over the blocks whose pixels are valid (H, W)."""
    whole = _whole(valid, recipe)
    if recipe.contrast == "channels":
        least, most = image.min(axis=-1), image.max(axis=-1)
        low, high = _extremes(least, whole, recipe)[0].astype(float), _extremes(most, whole, recipe)[1].astype(float)
    else:
        luma = image @ np.array((0.2125, 0.7154, 0.0721)) / 255 if recipe.contrast == "plip-unit" else image @ _LUMA
        low, high = _extremes(luma, whole, recipe)
    if recipe.contrast in ("plain", "channels"):
        return float(-_m_ln_m(high - low, high + low).mean())
    terms = _m_ln_m(_PLIP * (high - low) / (_PLIP - low), high + low - high * low / _PLIP)  # all <= 0
    if recipe.contrast == "plip-unit":
        return float(_PLIP - _PLIP * (1 - terms.sum() / _PLIP) ** (1 / terms.size))
    # c (x) g = gamma - gamma (1 - g / gamma)^c of a PLIP sum, for which 1 - g / gamma is the product of its terms'
    return float(_PLIP - _PLIP * np.exp(np.log1p(terms / _PLIP).mean()))


def _m_ln_m(above: Array, below: Array) -> Array:
    """m ln m of m = above / below, 0 where there is no contrast."""
    m = above / np.where(below > 0, below, 1)
    return np.asarray(m * np.log(np.where(m > 0, m, 1)))


def _with_neighbours(valid: Mask) -> Mask:
    """Pixels whose 3x3 neighbours are valid; the image's edge is reflected and so does no harm."""
    import cv2

    return cv2.erode(valid.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0


def _whole(valid: Mask, recipe: Recipe) -> Mask:
    """Blocks (k1, k2) all of whose pixels are valid (H, W)."""
    return np.asarray(_blocks(valid, recipe).all(axis=(1, 3)))


def _extremes(plane: npt.NDArray[Any], whole: Mask, recipe: Recipe) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
    """Least and greatest value of each whole block."""
    blocks = _blocks(plane, recipe)
    return blocks.min(axis=(1, 3))[whole], blocks.max(axis=(1, 3))[whole]


def _blocks(plane: npt.NDArray[Any], recipe: Recipe) -> npt.NDArray[Any]:
    """View a plane (H, W) as (k1, side, k2, side); a cut block is filled with its own last row or column."""
    side = recipe.block
    h, w = plane.shape
    if recipe.partial_blocks:
        plane = np.pad(plane, [(0, -h % side), (0, -w % side)], mode="edge")
    k1, k2 = plane.shape[0] // side, plane.shape[1] // side
    return plane[: k1 * side, : k2 * side].reshape(k1, side, k2, side)
