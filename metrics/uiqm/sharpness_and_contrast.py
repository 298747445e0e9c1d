"""Sharpness and contrast in UIQM, by blocks: the range of edges or levels (EME), and its entropy (logAMEE)."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import AnyArray, Array, Mask, once
from sucre_bench.errors import NotApplicableError
from sucre_bench.imaging.encoding import eight_bit
from sucre_bench.machine.compute import compiled

Plane = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Extremes:
    """The least and the greatest value of every block, cut ones included, each (..., k1, k2)."""

    least: AnyArray
    most: AnyArray


@once
def edge_extremes(shown: AnyArray, side: int) -> Extremes:
    """Return the extremes (3, k1, k2) float64 of C |Sobel(C)| in each channel C of 8 bits."""
    picture = eight_bit(shown)
    found = _empty((3,), picture.valid.shape, side, np.float32)
    for plane, least, most in zip(picture.planes, found.least, found.most, strict=True):
        compiled(_weighted_edges)(plane, side, least, most)
    return Extremes(found.least.astype(np.float64), found.most.astype(np.float64))


@once
def level_extremes(shown: AnyArray, side: int, weights: tuple[int, int, int]) -> Extremes:
    """Return the extremes (k1, k2) int32 of a weighted sum of the 8-bit channels, whole numbers being its weights."""
    picture = eight_bit(shown)
    found = _empty((), picture.valid.shape, side, np.int32)
    compiled(_weighted_levels)(
        picture.planes, np.array(weights, np.int32), side, found.least, found.most
    )
    return found


def _level_extremes_of_channels(shown: AnyArray, side: int) -> Extremes:
    """Of each channel (3, k1, k2)."""
    planes = [level_extremes(shown, side, unit) for unit in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    return Extremes(
        np.stack([plane.least for plane in planes]), np.stack([plane.most for plane in planes])
    )


@once
def whole_blocks(shown: AnyArray, side: int, margin: bool, cut: bool) -> Mask:
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
def _with_neighbours(shown: AnyArray) -> Mask:
    """Pixels whose 3x3 neighbours all have a colour."""
    import cv2

    picture = eight_bit(shown)
    if picture.is_whole:
        return picture.valid
    return cv2.erode(picture.valid.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0


def _empty(
    planes: tuple[int, ...], shape: tuple[int, ...], side: int, dtype: type[np.generic]
) -> Extremes:
    grid = planes + tuple(-(-n // side) for n in shape)
    return Extremes(np.empty(grid, dtype), np.empty(grid, dtype))


def _weighted_edges(plane: Plane, side: int, least: Array, most: Array) -> None:
    """A row at a time, so that the loops over columns become vector code; the edge is repeated outwards."""
    height, width = plane.shape
    smooth, step = np.empty(width + 2, np.int32), np.empty(width + 2, np.int32)
    low, high = np.empty(width, np.float32), np.empty(width, np.float32)
    for block in range(least.shape[0]):
        low[:] = np.inf
        high[:] = -1
        for y in range(block * side, min((block + 1) * side, height)):
            above, here, below = plane[max(y - 1, 0)], plane[y], plane[min(y + 1, height - 1)]
            for x in range(width):
                smooth[x + 1] = np.int32(above[x]) + 2 * np.int32(here[x]) + np.int32(below[x])
                step[x + 1] = np.int32(below[x]) - np.int32(above[x])
            smooth[0], smooth[width + 1], step[0], step[width + 1] = (
                smooth[1],
                smooth[width],
                step[1],
                step[width],
            )
            for x in range(width):
                across = smooth[x + 2] - smooth[x]
                down = step[x] + 2 * step[x + 1] + step[x + 2]
                edge = np.float32(here[x]) * np.sqrt(np.float32(across * across + down * down))
                low[x] = edge if edge < low[x] else low[x]
                high[x] = edge if edge > high[x] else high[x]
        for column in range(least.shape[1]):
            least[block, column] = low[column * side : (column + 1) * side].min()
            most[block, column] = high[column * side : (column + 1) * side].max()


def _weighted_levels(
    planes: Plane,
    weights: npt.NDArray[np.int32],
    side: int,
    least: AnyArray,
    most: AnyArray,
) -> None:
    _, height, width = planes.shape
    low, high = np.empty(width, np.int32), np.empty(width, np.int32)
    a, b, c = weights
    for block in range(least.shape[0]):
        low[:] = 2**31 - 1
        high[:] = -(2**31)
        for y in range(block * side, min((block + 1) * side, height)):
            red, green, blue = planes[0, y], planes[1, y], planes[2, y]
            for x in range(width):
                level = a * np.int32(red[x]) + b * np.int32(green[x]) + c * np.int32(blue[x])
                low[x] = level if level < low[x] else low[x]
                high[x] = level if level > high[x] else high[x]
        for column in range(least.shape[1]):
            least[block, column] = low[column * side : (column + 1) * side].min()
            most[block, column] = high[column * side : (column + 1) * side].max()


# -- the picture brought to a multiple of the block's side -----------------------------------------------------


@once
def resized_extremes(shown: AnyArray, side: int, edges: bool) -> Extremes:
    """Return the extremes (3, k1, k2) float64 of each 8-bit channel, resized to the next multiple of `side`.

    It is enlarged by cubic convolution (Keys 1981, a = -1/2; edges reflected), unrounded, so that values may leave 0 to
    255. edges: of |S_x - S_y| in place of the channel, S the Sobel filters to the right and down, edges repeated.
    """
    import cv2

    picture = eight_bit(shown)
    found = _empty((3,), picture.valid.shape, side, np.float64)
    rows, columns = (_taps(n, side) for n in picture.valid.shape)
    for plane, least, most in zip(picture.planes, found.least, found.most, strict=True):
        levels = plane.astype(np.int16)
        if edges:
            right, down = (
                cv2.Sobel(plane, cv2.CV_16S, x, 1 - x, borderType=cv2.BORDER_REPLICATE)
                for x in (1, 0)
            )
            levels = np.abs(right - down).astype(np.int16)
        compiled(_resized)(levels, *rows, *columns, side, least, most)
    return found


@once
def whole_resized_blocks(shown: AnyArray, side: int, margin: bool) -> Mask:
    """Return which blocks (k1, k2) of the resized picture are made of pixels with a colour alone.

    margin: and of such neighbours of pixels, as edges are.
    """
    valid = _with_neighbours(shown) if margin else eight_bit(shown).valid
    if eight_bit(shown).is_whole:
        return np.ones([-(-n // side) for n in valid.shape], np.bool_)
    for axis, n in enumerate(valid.shape):
        index, _ = _taps(n, side)
        # (blocks, 4, side) pixels each is made of
        used = np.moveaxis(index.reshape(len(index), -1, side), 1, 0)
        valid = np.stack(
            [valid.take(block.ravel(), axis).all(axis=axis) for block in used], axis=axis
        )
    return valid


def _taps(n: int, side: int) -> tuple[npt.NDArray[np.uint32], Array]:
    """Which of n pixels (4, m), and with which weights (4, m), make each of m, the next multiple of `side`."""
    m = -(-n // side) * side
    place = (np.arange(m) + 0.5) * n / m - 0.5
    index = np.floor(place).astype(np.intp) + np.arange(-1, 3)[:, None]
    t = np.abs(place - index)
    near, far = 1.5 * t**3 - 2.5 * t**2 + 1, -0.5 * t**3 + 2.5 * t**2 - 4 * t + 2
    weight = np.where(t <= 1, near, np.where(t <= 2, far, 0))
    # numba looks no sign up
    mirrored = np.r_[np.arange(n), np.arange(n)[::-1]].astype(np.uint32)
    return mirrored[index % (2 * n)], weight / weight.sum(axis=0)


def _resized(
    plane: npt.NDArray[np.int16],
    row_index: npt.NDArray[np.uint32],
    row_weight: Array,
    column_index: npt.NDArray[np.uint32],
    column_weight: Array,
    side: int,
    least: Array,
    most: Array,
) -> None:
    width, wide = plane.shape[1], column_index.shape[1]
    line, low, high = np.empty(width), np.empty(wide), np.empty(wide)
    at0, at1, at2, at3 = column_index
    by0, by1, by2, by3 = column_weight
    for block in range(least.shape[0]):
        low[:] = np.inf
        high[:] = -np.inf
        for y in range(block * side, (block + 1) * side):
            w0, w1, w2, w3 = row_weight[:, y]
            i0, i1, i2, i3 = row_index[:, y]
            row0, row1, row2, row3 = plane[i0], plane[i1], plane[i2], plane[i3]
            for x in range(width):
                line[x] = w0 * row0[x] + w1 * row1[x] + w2 * row2[x] + w3 * row3[x]
            for x in range(wide):
                value = (
                    by0[x] * line[at0[x]]
                    + by1[x] * line[at1[x]]
                    + by2[x] * line[at2[x]]
                    + by3[x] * line[at3[x]]
                )
                low[x] = value if value < low[x] else low[x]
                high[x] = value if value > high[x] else high[x]
        for column in range(least.shape[1]):
            least[block, column] = low[column * side : (column + 1) * side].min()
            most[block, column] = high[column * side : (column + 1) * side].max()


# UIConM, the contrast in UIQM: the entropy of the levels' range in blocks (logAMEE).

_PLIP = 1026.0  # gamma and k
_LUMA = (299, 587, 114)  # thousandths
_REC709 = (2125, 7154, 721)  # ten-thousandths


@dataclass(frozen=True, slots=True)
class Contrast:
    """The points on which implementations of UIConM differ."""

    levels: Literal["luma", "rec709", "together", "each"] = "luma"
    """What the levels are of. "luma" (.299 .587 .114), "rec709" (over 255, in [0, 1]): one intensity; "together":
    extremes over all three channels; "each": the modulus of each channel's mean, summed, of the picture that
    `resized_extremes` enlarges."""

    plip: bool = True
    """Whether m is made with (-) and (+), else - and +."""

    total: Literal["plip", "plain", "mean"] = "plip"
    """How blocks are summed. "plip": a PLIP sum, positive; "plain": a plain sum with the PLIP factor, its sign as
    printed; "mean": the mean, positive."""

    order: Literal["RGB", "BGR"] = "RGB"
    """Which channel is taken for R, G and B."""

    # See `Sharpness`.
    block: int = 10
    cut_blocks: bool = False
    fractional: bool = False

    fails_on_black: bool = False
    """Whether the program divides by 0 where a block is black."""


def uiconm(shown: AnyArray, form: Contrast = Contrast()) -> float:
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
        extremes = Extremes(
            found.least.min(axis=0).astype(np.float64),
            found.most.max(axis=0).astype(np.float64),
        )
    else:
        weights, scale = (_LUMA, 1e3) if form.levels == "luma" else (_REC709, 1e4 * 255)
        red, green, blue = weights if form.order == "RGB" else weights[::-1]
        found = level_extremes(shown, form.block, (red, green, blue))
        extremes = Extremes(found.least / scale, found.most / scale)
    k1, k2 = whole.shape
    # (..., B)
    low, high = (x[..., :k1, :k2][..., whole] for x in (extremes.least, extremes.most))
    if form.fails_on_black and (high == 0).any():
        raise NotApplicableError(
            f"a block of {form.block}x{form.block} pixels is black, where the program divides 0 by 0"
        )
    if form.levels == "each":
        return float(
            sum(abs(_m_ln_m(channel).mean()) for channel in _ratio(high - low, high + low))
        )
    if not form.plip:
        return float(
            -_m_ln_m(_ratio(high - low, high + low)).real.mean() * _share(shown, whole, form)
        )
    m = _ratio(_PLIP * (high - low) / (_PLIP - low), high + low - high * low / _PLIP)
    terms = _m_ln_m(m).real  # all <= 0
    if form.total == "plain":
        return float(_PLIP - _PLIP * (1 - terms.sum() / _PLIP) ** (1 / terms.size))
    # c (x) g = gamma - gamma (1 - g / gamma)^c of a PLIP sum, for which 1 - g / gamma is the product of its terms'
    return float(_PLIP - _PLIP * np.exp(np.log1p(terms / _PLIP).mean()))


def uiconm_blocks(shown: AnyArray, form: Contrast = Contrast()) -> Mask:
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
    """The points on which implementations of UISM differ."""

    weights: tuple[float, float, float] = (0.299, 0.587, 0.114)
    """Of EME(R), EME(G), EME(B)."""

    block: int = 10
    """Side of a block, pixels."""

    cut_blocks: bool = False
    """Whether blocks cut by the image's edge count."""

    edges: Literal["sobel", "rounded", "levels", "resized"] = "sobel"
    """What EME is of. "sobel": C |Sobel(C)|; "rounded": C |Sobel(C / 255)| to the nearest whole number; "levels": C
    itself; "resized": |S_x - S_y|, resized to a multiple of the block, see `resized_extremes`."""

    zero: Zero = "nothing"
    """What a block with a 0 counts as. "nothing": nothing; "one": ln(max / 1); "almost": ln(max / 1 + .00001), which is
    added in every block."""

    fractional: bool = False
    """Whether the sum over blocks is divided by (H / side) (W / side), whole or not."""


def uism(shown: AnyArray, form: Sharpness = Sharpness()) -> float:
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
        # the filter as scikit-image scales it: steps of 1 give 1, two directions averaged
        scale = 4 * 255 * np.sqrt(2)
        extremes = Extremes(np.round(extremes.least / scale), np.round(extremes.most / scale))
    k1, k2 = whole.shape
    channels = zip(
        form.weights, extremes.least[:, :k1, :k2], extremes.most[:, :k1, :k2], strict=True
    )
    return float(
        sum(w * eme(least[whole], most[whole], form.zero) for w, least, most in channels)
        * _share(shown, whole, form)
    )


def uism_blocks(shown: AnyArray, form: Sharpness = Sharpness()) -> Mask:
    """Return which blocks (k1, k2) are whole."""
    if form.edges == "resized":
        return whole_resized_blocks(shown, form.block, margin=True)
    return whole_blocks(shown, form.block, margin=True, cut=form.cut_blocks)


def _share(shown: AnyArray, whole: Mask, form: Sharpness | Contrast) -> float:
    """Whole blocks over (H / side) (W / side) where the form divides by that, else 1."""
    return (
        whole.size / ((shown.shape[0] / form.block) * (shown.shape[1] / form.block))
        if form.fractional
        else 1.0
    )


def eme(least: AnyArray, most: AnyArray, zero: Zero = "nothing") -> float:
    """Return 2 x the mean of ln(most / least) over blocks (B,); its modulus, where values below 0 make it complex."""
    if zero == "almost":
        return float(2 * np.log(most / np.where(least == 0, 1, least) + 1e-5).mean())
    if zero == "one":
        least, most = np.where(least == 0, 1, least), np.where(most == 0, 1, most)
    usable = (least != 0) & (most != 0)
    ratio = most[usable] / least[usable]
    total = complex(np.log(np.abs(ratio)).sum(), np.pi * np.count_nonzero(ratio < 0))
    return 2 * abs(total) / least.size
