"""A made seabed: ground, texture, and the rays that meet it.

World coordinates are in metres, z up. The ground is a height field of several octaves with boulders and a ledge, so it
has depth edges. Its texture has nine octaves, from metres down to less than a pixel. Nothing here is shared with the
demo dataset, so an error of one does not hide in the other.
"""

from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.machine.compute import compile_loop

RAYS = 3  # on a side of a pixel; the middle one passes through the pixel's centre
FAR_M = 25.0  # no ground is seen beyond
CELL_M = 0.025
CELLS = 2048  # on a side; the ground repeats after that
TEXTURE_M = 2.2
TEXTURE_OCTAVES = 9
TEXTURE_FALL = 0.78
_LATTICE = 256


@compile_loop
def _noise(lattice: Array, x: float, y: float) -> float:
    """Return smooth noise of period 1: values of a lattice, interpolated with continuous second derivatives."""
    i, j = int(np.floor(x)), int(np.floor(y))
    u, v = x - i, y - j
    u, v = u * u * u * (u * (6 * u - 15) + 10), v * v * v * (v * (6 * v - 15) + 10)
    i, j, i1, j1 = i & 255, j & 255, (i + 1) & 255, (j + 1) & 255
    low = lattice[j, i] + u * (lattice[j, i1] - lattice[j, i])
    high = lattice[j1, i] + u * (lattice[j1, i1] - lattice[j1, i])
    return low + v * (high - low)


@compile_loop
def octaves(lattice: Array, xy: Array, scale_m: float, count: int, fall: float) -> Array:
    """Return noise (N,) of mean 0 and deviation of about 1 at places (N, 2): octaves of which each is turned."""
    values = np.zeros(len(xy))
    for n in range(len(xy)):
        x, y = xy[n, 0] / scale_m, xy[n, 1] / scale_m
        amplitude = 1.0
        power = 0.0
        for _ in range(count):
            values[n] += amplitude * _noise(lattice, x, y)
            power += amplitude * amplitude
            amplitude *= fall
            x, y = 1.97 * (0.8 * x - 0.6 * y) + 11.3, 1.97 * (0.6 * x + 0.8 * y) + 7.7
        values[n] /= 0.38 * np.sqrt(power)
    return values


@compile_loop
def _height(heights: Array, x: float, y: float) -> float:
    x, y = x / CELL_M, y / CELL_M
    i, j = int(np.floor(x)), int(np.floor(y))
    u, v = x - i, y - j
    i = i & (CELLS - 1)
    j = j & (CELLS - 1)
    i1 = (i + 1) & (CELLS - 1)
    j1 = (j + 1) & (CELLS - 1)
    low = heights[j, i] + u * (heights[j, i1] - heights[j, i])
    high = heights[j1, i] + u * (heights[j1, i1] - heights[j1, i])
    return low + v * (high - low)


@compile_loop
def _meet(heights: Array, top: float, origin: Array, ray: Array) -> float:
    """Return the distance at which a ray, a unit vector, meets the ground; -1 if it does not within FAR_M."""
    t = 0.05
    if origin[2] > top:
        if ray[2] >= 0:
            return -1.0
        t = max(t, (top - origin[2]) / ray[2])
    before = t
    while t < FAR_M:
        above = (
            origin[2]
            + t * ray[2]
            - _height(heights, origin[0] + t * ray[0], origin[1] + t * ray[1])
        )
        if above <= 0:
            for _ in range(20):
                middle = 0.5 * (before + t)
                x, y = origin[0] + middle * ray[0], origin[1] + middle * ray[1]
                if origin[2] + middle * ray[2] > _height(heights, x, y):
                    before = middle
                else:
                    t = middle
            return t
        before = t
        t += max(0.4 * above, 0.01)  # boulders have slopes up to 3
    return -1.0


@compile_loop
def _cast(
    heights: Array,
    top: float,
    origin: Array,
    turn: Array,
    K: Array,
    width: int,
    first: int,
    last: int,
) -> tuple[Array, Array]:
    distance = np.empty((last - first, RAYS * RAYS))
    points = np.zeros((last - first, RAYS * RAYS, 3))
    ray = np.empty(3)
    for pixel in range(first, last):
        for k in range(RAYS * RAYS):
            x = (pixel % width + (k % RAYS + 0.5) / RAYS - K[0, 2]) / K[0, 0]
            y = (pixel // width + (k // RAYS + 0.5) / RAYS - K[1, 2]) / K[1, 1]
            length = np.sqrt(x * x + y * y + 1)
            for a in range(3):
                ray[a] = (turn[0, a] * x + turn[1, a] * y + turn[2, a]) / length
            t = _meet(heights, top, origin, ray)
            distance[pixel - first, k] = t
            for a in range(3):
                points[pixel - first, k, a] = origin[a] + t * ray[a]
    return distance, points


@dataclass(frozen=True, eq=False)
class Seabed:
    """The ground."""

    heights: Array
    """In metres, (CELLS, CELLS)."""

    lattices: Array
    """Noise for its texture, (4, n, n)."""

    def cast(
        self, K: Array, pose: Array, width: int, first: int, last: int
    ) -> tuple[Array, Array]:
        """Return distance (P, 9), -1 for open water, and points (P, 9, 3) of all rays of pixels first to last."""
        turn = np.ascontiguousarray(pose[:3, :3])
        distance, points = _cast(
            self.heights, self.heights.max(), -turn.T @ pose[:3, 3], turn, K, width, first, last
        )
        return distance, points

    def albedo(self, points: Array) -> Array:
        """Return colours (..., 3) from 0.05 to 0.9 of points (..., 3); the channels are partly independent."""
        xy = points[..., :2].reshape(-1, 2) + 0.7 * points[..., 2:].reshape(-1, 1)
        gray, *own = (
            octaves(one, xy, TEXTURE_M, TEXTURE_OCTAVES, TEXTURE_FALL) for one in self.lattices
        )
        mixed = 0.9 * gray[:, None] + 0.4 * np.stack(own, axis=1) + np.array([-0.7, -0.9, -1.2])
        return (0.05 + 0.85 / (1 + np.exp(-0.5 * mixed))).reshape(points.shape)


def make_seabed(rng: np.random.Generator, relief_m: float) -> Seabed:
    """Return a seabed whose heights vary by about relief_m, with boulders and a ledge in proportion to it."""
    lattices = rng.uniform(-1, 1, (5, _LATTICE, _LATTICE))
    x, y = np.meshgrid(*[np.arange(CELLS) * CELL_M] * 2)
    xy = np.stack([x.ravel(), y.ravel()], axis=1)
    heights = relief_m / 4 * octaves(lattices[4], xy, 3.0, 5, 0.45).reshape(x.shape)
    heights += 0.3 * relief_m / (1 + np.exp(-(x + 0.3 * y - 1.1) / 0.02))  # a ledge
    if relief_m > 0.05:
        for _ in range(60):
            (left, low), radius = rng.uniform((-6, -4), (6, 14)), rng.uniform(0.12, 0.45)
            away = np.arange(-radius, radius, CELL_M)
            near = np.ix_(
                *(
                    np.floor((middle + away) / CELL_M).astype(int) % CELLS
                    for middle in (low, left)
                )
            )
            inside = np.maximum(1 - ((away**2 + away[:, None] ** 2) / radius**2) ** 2, -1)
            boulder = heights[near].mean() + min(1, relief_m / 0.35) * 0.7 * radius * inside
            heights[near] = np.maximum(heights[near], boulder)
    return Seabed(heights.astype(np.float32), lattices[:4])
