"""Haze-lines: pixels of one colour at all distances lie on a line through the veiling light.

With the veiling light A and the ratios of attenuation beta_B / beta_c of the water, every channel is brought to the
same transmission, blue's: sign(I - A) |I - A|^(beta_B / beta_c) = t_B sign(J - A) |J - A|^(beta_B / beta_c). In this
space a scene colour, fading, moves straight towards 0. The length along its line is the transmission, up to the length
of what has not faded at all. Berman et al. 2021.
"""

import functools

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.filters import guided_filter
from sucre_bench.methods.haze_lines.jerlov import WaterType

_HAZE_FREE = 0.9  # transmission of a line's farthest pixel: it, too, has water before it
_BAND = 256  # rows at once


@functools.cache
def directions(n: int) -> Array:
    """Return (n, 3) unit vectors spread evenly over the sphere: a Fibonacci lattice (Gonzalez 2010)."""
    i = np.arange(n)
    z = 1 - (2 * i + 1) / n
    turn = i * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - z * z)
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)
    points.setflags(write=False)
    return points


def transmission(
    image: Array, A: Array, water: WaterType, likeness: Array, *, lines: int, radius: int, eps: float, least: float
) -> Array:
    """Return blue's transmission (H, W) float32 in [least, 1], in water of a type.

    image: (H, W, 3) float32 intensities; A: (3,) veiling light; likeness: (H, W), 1 where a pixel shows nothing but
    water and so lies on no line: it gets the least transmission that its colour allows; lines: how many clusters;
    radius, eps: of the guided filter; least: transmission.
    """
    length, line = np.empty(image.shape[:2], np.float32), np.empty(image.shape[:2], np.int32)
    for rows in _bands(len(image)):
        length[rows], line[rows] = along_lines(compensated(image[rows], A, water), lines)
    longest = np.zeros(lines, np.float32)
    np.maximum.at(longest, line.ravel(), length.ravel())
    t = np.empty_like(length)
    for rows in _bands(len(image)):
        bound = np.maximum(least_transmission(image[rows], A, water), least)
        along = np.maximum(_HAZE_FREE * length[rows] / np.maximum(longest, 1e-9)[line[rows]], bound)
        t[rows] = along + likeness[rows] * (bound - along)
    return guided_filter(image, t, radius, eps).clip(least, 1)


def _bands(height: int) -> list[slice]:
    return [slice(top, min(top + _BAND, height)) for top in range(0, height, _BAND)]


def compensated(image: Array, A: Array, water: WaterType) -> Array:
    """Return the difference from A (H, W, 3), each channel to the power beta_B / beta_c, its sign kept."""
    difference = image - A
    return np.asarray(np.copysign(np.abs(difference) ** water.exponents, difference))


def along_lines(points: Array, lines: int) -> tuple[Array, Array]:
    """Return the length of each vector of points (H, W, 3), and the number of the line nearest to its direction.

    lines: how many there are; line k has direction k of `directions(lines)`.
    """
    length = np.sqrt(np.einsum("...c,...c", points, points))
    unit = points / np.maximum(length, 1e-9)[..., None]
    return length, _nearest(unit, lines)


def _nearest(unit: Array, lines: int) -> Array:
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(directions(lines)).query(unit)[1])


def least_transmission(image: Array, A: Array, water: WaterType) -> Array:
    """Return blue's least transmission (H, W) with which no channel of J is below 0: max (1 - I / A)^(beta_B / beta_c).

    A channel that the veiling light lacks bounds nothing.
    """
    shortfall = (1 - image / np.maximum(A, 1e-4)).clip(0, 1) * (A > 1e-4)
    return functools.reduce(np.maximum, np.moveaxis(shortfall**water.exponents, -1, 0))


def channel_transmission(t: Array, water: WaterType, least: float) -> Array:
    """Return t_c = t^(beta_c / beta_B) (H, W, 3), no less than `least`."""
    return np.maximum(t[..., None] ** (1 / water.exponents), np.float32(least))
