"""Sharpness and contrast in UIQM, by blocks: the range of edges or levels (EME), and its entropy (logAMEE)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array, Mask, once
from sucre_bench.errors import NotApplicableError
from sucre_bench.imaging.encoding import eight_bit

_BAND = 200  # rows that are looked at together, about


@dataclass(frozen=True, slots=True, eq=False)
class Extremes:
    """least, most: (..., k1, k2), of every block, cut ones included."""

    least: npt.NDArray[Any]
    most: npt.NDArray[Any]


def _extremes(levels: Callable[[int, int], npt.NDArray[Any]], height: int, side: int) -> Extremes:
    """Return the extremes of blocks. levels: returns rows (..., rows, W) from the first to before the last."""
    step = max(1, _BAND // side) * side
    found = []
    for start in range(0, height, step):
        band = levels(start, min(start + step, height))
        rows, columns = (np.arange(0, n, side) for n in band.shape[-2:])
        found.append([f.reduceat(f.reduceat(band, rows, -2), columns, -1) for f in (np.minimum, np.maximum)])
    return Extremes(*(np.concatenate(bands, axis=-2) for bands in zip(*found, strict=True)))


@once
def edge_extremes(shown: npt.NDArray[Any], side: int) -> Extremes:
    """Return the extremes (3, k1, k2) float64 of C |Sobel(C)| in each channel C of 8 bits."""
    import cv2

    planes = eight_bit(shown).planes
    height = planes.shape[1]

    def edges(start: int, end: int) -> npt.NDArray[np.float32]:
        first = max(start - 1, 0)
        made = []
        for plane in planes[:, first : end + 1]:  # the picture's edge is repeated outwards
            across, down = (cv2.Sobel(plane, cv2.CV_32F, x, 1 - x, borderType=cv2.BORDER_REPLICATE) for x in (1, 0))
            made.append((plane * np.sqrt(across * across + down * down))[start - first :][: end - start])
        return np.stack(made)

    found = _extremes(edges, height, side)
    return Extremes(found.least.astype(np.float64), found.most.astype(np.float64))


@once
def level_extremes(shown: npt.NDArray[Any], side: int, weights: tuple[int, int, int]) -> Extremes:
    """Return the extremes (k1, k2) int32 of a weighted sum of the 8-bit channels, whole numbers being its weights."""
    planes = eight_bit(shown).planes

    def levels(start: int, end: int) -> npt.NDArray[np.int32]:
        return sum(np.int32(w) * plane.astype(np.int32) for w, plane in zip(weights, planes[:, start:end], strict=True))

    return _extremes(levels, planes.shape[1], side)


def _level_extremes_of_channels(shown: npt.NDArray[Any], side: int) -> Extremes:
    """Of each channel (3, k1, k2)."""
    planes = [level_extremes(shown, side, unit) for unit in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    return Extremes(np.stack([plane.least for plane in planes]), np.stack([plane.most for plane in planes]))


@once
def whole_blocks(shown: npt.NDArray[Any], side: int, margin: bool, cut: bool) -> Mask:
    """Return which blocks (k1, k2) have a colour in every pixel.

    margin: in every neighbour of a pixel, too (the image's edge does no harm); cut: with the blocks that the edge cuts.
    """
    valid = _with_neighbours(shown) if margin else eight_bit(shown).valid
    h, w = valid.shape if cut else (n - n % side for n in valid.shape)
    if eight_bit(shown).is_whole or not h or not w:
        return np.ones((-(-h // side), -(-w // side)), np.bool_)
    rows = np.logical_and.reduceat(valid[:h, :w], np.arange(0, h, side), axis=0)
    return np.asarray(np.logical_and.reduceat(rows, np.arange(0, w, side), axis=1))


@once
def _with_neighbours(shown: npt.NDArray[Any]) -> Mask:
    """Pixels whose 3x3 neighbours all have a colour."""
    import cv2

    picture = eight_bit(shown)
    if picture.is_whole:
        return picture.valid
    return cv2.erode(picture.valid.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0


# -- the picture brought to a multiple of the block's side -----------------------------------------------------


@once
def resized_extremes(shown: npt.NDArray[Any], side: int, edges: bool) -> Extremes:
    """Return the extremes (3, k1, k2) float64 of each 8-bit channel, resized to the next multiple of `side`.

    It is enlarged by cubic convolution (Keys 1981, a = -1/2; edges reflected), unrounded, so that values may leave 0 to
    255. edges: of |S_x - S_y| in place of the channel, S the Sobel filters to the right and down, edges repeated.
    """
    import cv2

    planes = eight_bit(shown).planes.astype(np.int16)
    if edges:
        for plane in planes:
            right, down = (cv2.Sobel(plane, cv2.CV_16S, x, 1 - x, borderType=cv2.BORDER_REPLICATE) for x in (1, 0))
            plane[:] = np.abs(right - down)
    rows, columns = (_taps(n, side) for n in planes.shape[1:])

    def resized(start: int, end: int) -> Array:
        lines = sum(w[:, None] * planes[:, at] for at, w in zip(*(part[:, start:end] for part in rows), strict=True))
        return np.asarray(sum(w * lines.take(at, -1) for at, w in zip(*columns, strict=True)))

    return _extremes(resized, rows[0].shape[1], side)


@once
def whole_resized_blocks(shown: npt.NDArray[Any], side: int, margin: bool) -> Mask:
    """Return which blocks (k1, k2) of the resized picture are made of pixels with a colour alone.

    margin: and of such neighbours of pixels, as edges are.
    """
    valid = _with_neighbours(shown) if margin else eight_bit(shown).valid
    if eight_bit(shown).is_whole:
        return np.ones([-(-n // side) for n in valid.shape], np.bool_)
    for axis, n in enumerate(valid.shape):
        index, _ = _taps(n, side)
        used = np.moveaxis(index.reshape(len(index), -1, side), 1, 0)  # (blocks, 4, side) pixels each is made of
        valid = np.stack([valid.take(block.ravel(), axis).all(axis=axis) for block in used], axis=axis)
    return valid


def _taps(n: int, side: int) -> tuple[npt.NDArray[np.intp], Array]:
    """Which of n pixels (4, m), and with which weights (4, m), make each of m, the next multiple of `side`."""
    m = -(-n // side) * side
    place = (np.arange(m) + 0.5) * n / m - 0.5
    index = np.floor(place).astype(np.intp) + np.arange(-1, 3)[:, None]
    t = np.abs(place - index)
    near, far = 1.5 * t**3 - 2.5 * t**2 + 1, -0.5 * t**3 + 2.5 * t**2 - 4 * t + 2
    weight = np.where(t <= 1, near, np.where(t <= 2, far, 0))
    mirrored = np.r_[np.arange(n), np.arange(n)[::-1]]
    return mirrored[index % (2 * n)], weight / weight.sum(axis=0)


# UIConM, the contrast in UIQM: the entropy of the levels' range in blocks (logAMEE).

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
    if form.levels == "each":
        extremes = resized_extremes(shown, form.block, edges=False)
    elif form.levels == "together":
        found = _level_extremes_of_channels(shown, form.block)
        extremes = Extremes(found.least.min(axis=0).astype(np.float64), found.most.max(axis=0).astype(np.float64))
    else:
        weights, scale = (_LUMA, 1e3) if form.levels == "luma" else (_REC709, 1e4 * 255)
        red, green, blue = weights if form.order == "RGB" else weights[::-1]
        found = level_extremes(shown, form.block, (red, green, blue))
        extremes = Extremes(found.least / scale, found.most / scale)
    k1, k2 = whole.shape
    low, high = (x[..., :k1, :k2][..., whole] for x in (extremes.least, extremes.most))  # (..., B)
    if form.fails_on_black and (high == 0).any():
        raise NotApplicableError(
            f"a block of {form.block}x{form.block} pixels is black, where the program divides 0 by 0"
        )
    if form.levels == "each":
        return float(sum(abs(_m_ln_m(channel).mean()) for channel in _ratio(high - low, high + low)))
    if not form.plip:
        return float(-_m_ln_m(_ratio(high - low, high + low)).real.mean() * _share(shown, whole, form))
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


# UISM, the sharpness in UIQM: the range of edges, or of levels, in blocks (EME).

Zero = Literal["nothing", "one", "almost"]


@dataclass(frozen=True, slots=True)
class Sharpness:
    """The points on which implementations of UISM differ.

    weights: of EME(R), EME(G), EME(B); block: its side, pixels; cut_blocks: whether blocks cut by the image's edge
    count; edges: what EME is of: "sobel", C |Sobel(C)|; "rounded", C |Sobel(C / 255)| to the nearest whole number;
    "levels", C itself; "resized", |S_x - S_y|, resized to a multiple of the block, see `resized_extremes`;
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
    if form.edges == "resized":
        extremes = resized_extremes(shown, form.block, edges=True)
    elif form.edges == "levels":
        extremes = _level_extremes_of_channels(shown, form.block)
    else:
        extremes = edge_extremes(shown, form.block)
    if form.edges == "rounded":
        scale = 4 * 255 * np.sqrt(2)  # the filter as scikit-image scales it: steps of 1 give 1, two directions averaged
        extremes = Extremes(np.round(extremes.least / scale), np.round(extremes.most / scale))
    k1, k2 = whole.shape
    channels = zip(form.weights, extremes.least[:, :k1, :k2], extremes.most[:, :k1, :k2], strict=True)
    return float(
        sum(w * eme(least[whole], most[whole], form.zero) for w, least, most in channels) * _share(shown, whole, form)
    )


def uism_blocks(shown: npt.NDArray[Any], form: Sharpness = Sharpness()) -> Mask:
    """Return which blocks (k1, k2) are whole."""
    if form.edges == "resized":
        return whole_resized_blocks(shown, form.block, margin=True)
    return whole_blocks(shown, form.block, margin=True, cut=form.cut_blocks)


def _share(shown: npt.NDArray[Any], whole: Mask, form: Sharpness | Contrast) -> float:
    """Whole blocks over (H / side) (W / side) where the form divides by that, else 1."""
    return whole.size / ((shown.shape[0] / form.block) * (shown.shape[1] / form.block)) if form.fractional else 1.0


def eme(least: npt.NDArray[Any], most: npt.NDArray[Any], zero: Zero = "nothing") -> float:
    """Return 2 x the mean of ln(most / least) over blocks (B,); its modulus, where values below 0 make it complex."""
    if zero == "almost":
        return float(2 * np.log(most / np.where(least == 0, 1, least) + 1e-5).mean())
    if zero == "one":
        least, most = np.where(least == 0, 1, least), np.where(most == 0, 1, most)
    usable = (least != 0) & (most != 0)
    ratio = most[usable] / least[usable]
    total = complex(np.log(np.abs(ratio)).sum(), np.pi * np.count_nonzero(ratio < 0))
    return 2 * abs(total) / least.size
