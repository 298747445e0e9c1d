"""The least and greatest value in each block of a picture, for UISM and UIConM.

Blocks lie side by side from the top left; blocks that the right and lower edge cut are the last column and row.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array, Mask
from sucre_bench.imaging.encoding import eight_bit
from sucre_bench.imaging.once import once
from sucre_bench.machine.compile_loops import compiled

Plane = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Extremes:
    """least, most: (..., k1, k2), of every block, cut ones included."""

    least: npt.NDArray[Any]
    most: npt.NDArray[Any]


@once
def edge_extremes(shown: npt.NDArray[Any], side: int) -> Extremes:
    """Return the extremes (3, k1, k2) float64 of C |Sobel(C)| in each channel C of 8 bits."""
    picture = eight_bit(shown)
    found = _empty((3,), picture.valid.shape, side, np.float32)
    for plane, least, most in zip(picture.planes, found.least, found.most, strict=True):
        compiled(_weighted_edges)(plane, side, least, most)
    return Extremes(found.least.astype(np.float64), found.most.astype(np.float64))


@once
def level_extremes(shown: npt.NDArray[Any], side: int, weights: tuple[int, int, int]) -> Extremes:
    """Return the extremes (k1, k2) int32 of a weighted sum of the 8-bit channels, whole numbers being its weights."""
    picture = eight_bit(shown)
    found = _empty((), picture.valid.shape, side, np.int32)
    compiled(_weighted_levels)(picture.planes, np.array(weights, np.int32), side, found.least, found.most)
    return found


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


def _empty(planes: tuple[int, ...], shape: tuple[int, ...], side: int, dtype: type[np.generic]) -> Extremes:
    grid = planes + tuple(-(-n // side) for n in shape)
    return Extremes(np.empty(grid, dtype), np.empty(grid, dtype))


def _weighted_edges(plane: Plane, side: int, least: Array, most: Array) -> None:
    """A row at a time, so that the loops over columns become vector code; the edge is repeated outwards."""
    height, width = plane.shape
    smooth, step = np.empty(width + 2, np.int32), np.empty(width + 2, np.int32)
    low, high = np.empty(width, np.float32), np.empty(width, np.float32)
    for block in range(least.shape[0]):
        low[:], high[:] = np.inf, -1
        for y in range(block * side, min((block + 1) * side, height)):
            above, here, below = plane[max(y - 1, 0)], plane[y], plane[min(y + 1, height - 1)]
            for x in range(width):
                smooth[x + 1] = np.int32(above[x]) + 2 * np.int32(here[x]) + np.int32(below[x])
                step[x + 1] = np.int32(below[x]) - np.int32(above[x])
            smooth[0], smooth[width + 1], step[0], step[width + 1] = smooth[1], smooth[width], step[1], step[width]
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
    planes: Plane, weights: npt.NDArray[np.int32], side: int, least: npt.NDArray[Any], most: npt.NDArray[Any]
) -> None:
    _, height, width = planes.shape
    low, high = np.empty(width, np.int32), np.empty(width, np.int32)
    a, b, c = weights
    for block in range(least.shape[0]):
        low[:], high[:] = 2**31 - 1, -(2**31)
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
def resized_extremes(shown: npt.NDArray[Any], side: int, edges: bool) -> Extremes:
    """Return the extremes (3, k1, k2) float64 of each 8-bit channel, resized to the next multiple of `side`.

    It is enlarged by cubic convolution (Keys 1981, a = -1/2; edges reflected), unrounded, so that values may leave 0 to
    255. edges: of |S_x - S_y| in place of the channel, S the Sobel filters to the right and down, edges repeated.
    """
    picture = eight_bit(shown)
    found = _empty((3,), picture.valid.shape, side, np.float64)
    rows, columns = (_taps(n, side) for n in picture.valid.shape)
    for plane, least, most in zip(picture.planes, found.least, found.most, strict=True):
        levels = _edge_map(plane) if edges else plane.astype(np.int16)
        compiled(_resized)(levels, *rows, *columns, side, least, most)
    return found


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


def _edge_map(plane: Plane) -> npt.NDArray[np.int16]:
    import cv2

    right, down = (cv2.Sobel(plane, cv2.CV_16S, x, 1 - x, borderType=cv2.BORDER_REPLICATE) for x in (1, 0))
    return np.asarray(np.abs(right - down))


def _taps(n: int, side: int) -> tuple[npt.NDArray[np.uint32], Array]:
    """Which of n pixels (4, m), and with which weights (4, m), make each of m, the next multiple of `side`."""
    m = -(-n // side) * side
    place = (np.arange(m) + 0.5) * n / m - 0.5
    index = np.floor(place).astype(np.intp) + np.arange(-1, 3)[:, None]
    t = np.abs(place - index)
    near, far = 1.5 * t**3 - 2.5 * t**2 + 1, -0.5 * t**3 + 2.5 * t**2 - 4 * t + 2
    weight = np.where(t <= 1, near, np.where(t <= 2, far, 0))
    mirrored = np.r_[np.arange(n), np.arange(n)[::-1]].astype(np.uint32)  # numba looks no sign up
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
        low[:], high[:] = np.inf, -np.inf
        for y in range(block * side, (block + 1) * side):
            w0, w1, w2, w3 = row_weight[:, y]
            i0, i1, i2, i3 = row_index[:, y]
            row0, row1, row2, row3 = plane[i0], plane[i1], plane[i2], plane[i3]
            for x in range(width):
                line[x] = w0 * row0[x] + w1 * row1[x] + w2 * row2[x] + w3 * row3[x]
            for x in range(wide):
                value = by0[x] * line[at0[x]] + by1[x] * line[at1[x]] + by2[x] * line[at2[x]] + by3[x] * line[at3[x]]
                low[x] = value if value < low[x] else low[x]
                high[x] = value if value > high[x] else high[x]
        for column in range(least.shape[1]):
            least[block, column] = low[column * side : (column + 1) * side].min()
            most[block, column] = high[column * side : (column + 1) * side].max()
