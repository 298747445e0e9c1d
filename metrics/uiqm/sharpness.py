"""UISM, the sharpness in UIQM: the range of edges, or of levels, in blocks (EME)."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Mask
from sucre_bench.metrics.uiqm.blocks import (
    Extremes,
    edge_extremes,
    level_extremes,
    resized_extremes,
    whole_blocks,
    whole_resized_blocks,
)

Zero = Literal["nothing", "one", "almost"]


@dataclass(frozen=True, slots=True)
class Sharpness:
    """The points on which implementations of UISM differ.

    weights: of EME(R), EME(G), EME(B); block: its side, pixels; cut_blocks: whether blocks cut by the image's edge
    count; edges: what EME is of: "sobel", C |Sobel(C)|; "rounded", C |Sobel(C / 255)| to the nearest whole number;
    "levels", C itself; "resized", |S_x - S_y|, resized to a multiple of the block, see `blocks.resized_extremes`;
    zero: what a block with a 0 counts as: "nothing"; "one", ln(max / 1); "almost", ln(max / 1 + .00001), which is added
    in every block; fractional: the sum over blocks is divided by (H / side) (W / side), whole or not.
    """

    weights: tuple[float, float, float] = (0.299, 0.587, 0.114)
    block: int = 10
    cut_blocks: bool = False
    edges: Literal["sobel", "rounded", "levels", "resized"] = "sobel"
    zero: Zero = "nothing"
    fractional: bool = False


def uism(shown: npt.NDArray[Any], form: Sharpness = Sharpness()) -> float:
    """Return the sharpness of a picture (H, W, 3) in [0, 1]; NaN where no block is whole.

    A block is whole where every pixel, and every neighbour of one, has a colour.
    """
    whole = uism_blocks(shown, form)
    if not whole.any():
        return float("nan")
    extremes, (k1, k2) = _extremes(shown, form), whole.shape
    share = 1.0
    if form.fractional:
        share = k1 * k2 / ((shown.shape[0] / form.block) * (shown.shape[1] / form.block))
    channels = zip(form.weights, extremes.least[:, :k1, :k2], extremes.most[:, :k1, :k2], strict=True)
    return float(sum(w * eme(least[whole], most[whole], form.zero) for w, least, most in channels) * share)


def uism_blocks(shown: npt.NDArray[Any], form: Sharpness = Sharpness()) -> Mask:
    """Return which blocks (k1, k2) are whole."""
    if form.edges == "resized":
        return whole_resized_blocks(shown, form.block, margin=True)
    return whole_blocks(shown, form.block, margin=True, cut=form.cut_blocks)


def eme(
    least: npt.NDArray[Any], most: npt.NDArray[Any], zero: Literal["nothing", "one", "almost"] = "nothing"
) -> float:
    """Return 2 x the mean of ln(most / least) over blocks (B,); its modulus, where values below 0 make it complex."""
    if zero == "almost":
        return float(2 * np.log(most / np.where(least == 0, 1, least) + 1e-5).mean())
    if zero == "one":
        least, most = np.where(least == 0, 1, least), np.where(most == 0, 1, most)
    usable = (least != 0) & (most != 0)
    ratio = most[usable] / least[usable]
    total = complex(np.log(np.abs(ratio)).sum(), np.pi * np.count_nonzero(ratio < 0))
    return 2 * abs(total) / least.size


def _extremes(shown: npt.NDArray[Any], form: Sharpness) -> Extremes:
    """Of each channel (3, k1, k2)."""
    if form.edges == "resized":
        return resized_extremes(shown, form.block, edges=True)
    if form.edges == "levels":
        planes = [level_extremes(shown, form.block, unit) for unit in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
        return Extremes(np.stack([p.least for p in planes]), np.stack([p.most for p in planes]))
    found = edge_extremes(shown, form.block)
    if form.edges == "sobel":
        return found
    scale = 4 * 255 * np.sqrt(2)  # the filter as scikit-image scales it: steps of 1 give 1, two directions averaged
    return Extremes(np.round(found.least / scale), np.round(found.most / scale))
