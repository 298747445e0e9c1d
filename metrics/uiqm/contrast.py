"""UIConM, the contrast in UIQM: the entropy of the levels' range in blocks (logAMEE)."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array, Mask
from sucre_bench.errors import NotApplicableError
from sucre_bench.metrics.uiqm.blocks import (
    Extremes,
    level_extremes,
    resized_extremes,
    whole_blocks,
    whole_resized_blocks,
)

_PLIP = 1026.0  # gamma and k
_LUMA, _REC709 = (299, 587, 114), (2125, 7154, 721)  # thousandths, ten-thousandths


@dataclass(frozen=True, slots=True)
class Contrast:
    """The points on which implementations of UIConM differ.

    levels: "luma" (.299 .587 .114) and "rec709" (over 255, in [0, 1]) of one intensity; "together", extremes over all
    three channels; "each", the modulus of each channel's mean, summed, of the picture that `resized_extremes` enlarges;
    plip: whether m is made with (-) and (+), else - and +; total: "plip", a PLIP sum, positive; "plain", a plain sum
    with the PLIP factor, its sign as printed; "mean", the mean, positive; order: which channel is taken for R, G and B;
    block, cut_blocks, fractional: see `sharpness.Sharpness`; fails_on_black: the program divides by 0 there.
    """

    levels: Literal["luma", "rec709", "together", "each"] = "luma"
    plip: bool = True
    total: Literal["plip", "plain", "mean"] = "plip"
    order: Literal["RGB", "BGR"] = "RGB"
    block: int = 10
    cut_blocks: bool = False
    fractional: bool = False
    fails_on_black: bool = False


def uiconm(shown: npt.NDArray[Any], form: Contrast = Contrast()) -> float:
    """Return the contrast of a picture (H, W, 3) in [0, 1]; NaN where no block is whole.

    NotApplicableError where the program that the form stands for has no result.
    """
    whole = uiconm_blocks(shown, form)
    if not whole.any():
        return float("nan")
    extremes, (k1, k2) = _extremes(shown, form), whole.shape
    low, high = (x[..., :k1, :k2][..., whole] for x in (extremes.least, extremes.most))  # (..., B)
    if form.fails_on_black and (high == 0).any():
        raise NotApplicableError(
            f"a block of {form.block}x{form.block} pixels is black, where the program divides 0 by 0"
        )
    if form.levels == "each":
        return float(sum(abs(_m_ln_m(channel).mean()) for channel in _ratio(high - low, high + low)))
    if not form.plip:
        share = k1 * k2 / ((shown.shape[0] / form.block) * (shown.shape[1] / form.block)) if form.fractional else 1.0
        return float(-_m_ln_m(_ratio(high - low, high + low)).real.mean() * share)
    m = _ratio(_PLIP * (high - low) / (_PLIP - low), high + low - high * low / _PLIP)
    terms = _m_ln_m(m).real  # all <= 0
    if form.total == "plain":
        return float(_PLIP - _PLIP * (1 - terms.sum() / _PLIP) ** (1 / terms.size))
    # c (x) g = gamma - gamma (1 - g / gamma)^c of a PLIP sum, for which 1 - g / gamma is the product of its terms'
    return float(_PLIP - _PLIP * np.exp(np.log1p(terms / _PLIP).mean()))


def uiconm_blocks(shown: npt.NDArray[Any], form: Contrast = Contrast()) -> Mask:
    """Return which blocks (k1, k2) have a colour in every pixel."""
    if form.levels == "each":
        return whole_resized_blocks(shown, form.block, margin=False)
    return whole_blocks(shown, form.block, margin=False, cut=form.cut_blocks)


def _ratio(above: Array, below: Array) -> Array:
    """0 where there is no contrast, or nothing to divide by."""
    return np.where(below != 0, above / np.where(below != 0, below, 1), 0)


def _m_ln_m(m: Array) -> npt.NDArray[np.complex128]:
    """m ln m, 0 for 0; complex below 0."""
    logarithm = np.log(np.abs(np.where(m != 0, m, 1))) + 1j * np.pi * (m < 0)
    return np.asarray(m * logarithm)


def _extremes(shown: npt.NDArray[Any], form: Contrast) -> Extremes:
    if form.levels == "each":
        return resized_extremes(shown, form.block, edges=False)
    if form.levels == "together":
        planes = [level_extremes(shown, form.block, unit) for unit in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
        least, most = np.min([p.least for p in planes], axis=0), np.max([p.most for p in planes], axis=0)
        return Extremes(least.astype(np.float64), most.astype(np.float64))
    weights, scale = (_LUMA, 1e3) if form.levels == "luma" else (_REC709, 1e4 * 255)
    red, green, blue = weights if form.order == "RGB" else weights[::-1]
    found = level_extremes(shown, form.block, (red, green, blue))
    return Extremes(found.least / scale, found.most / scale)
