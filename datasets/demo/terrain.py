"""The seabed's shape: a sand flat with rubble and boulders that rises into a reef behind.

World axes: x right, y forward (towards the reef), z up, metres; the survey looks at the ground around the origin.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.datasets.demo.noise import Grid, Noise, smoothstep

# What the cameras see of the ground, and a little more; a ray must never miss it.
GROUND = Grid(x0=-10.0, y0=-5.5, width=20.0, length=16.0, cell=0.025)

# Boulders by size: how many, smallest and largest radius (m), how near the origin they may come (m).
_TIERS = ((26, 0.5, 1.2, 2.6), (320, 0.18, 0.5, 1.0), (5500, 0.04, 0.14, 0.0))
_CLEARING_M = 0.55  # around a chart
# Of a boulder's turn (rad), flatness, stretch, sinking and hue; of the angle (rad), slope and level of its cuts.
_LEAST, _MOST = np.array([(0, 0.5, 0.75, 0.02, -1), (np.pi, 0.75, 1, 0.2, 1)])
_LEAST_CUT, _MOST_OF_CUTS = np.array([(0, 0.3, 0.3), (2 * np.pi, 1.6, 0.8)])
_SPAN, _SPAN_OF_CUTS = _MOST - _LEAST, _MOST_OF_CUTS - _LEAST_CUT


@dataclass(frozen=True, eq=False)
class Terrain:
    """The seabed on a grid.

    height: (rows, columns) float32 metres; rock: height above the sand under it, metres, 0 on sand;
    tint: (rows, columns) float32, a random number in [-1, 1] for each boulder.
    """

    grid: Grid
    height: Array
    rock: Array
    tint: Array


@dataclass(frozen=True)
class _Boulder:
    x: float
    y: float
    radius: float


def make_terrain(seed: int, noise: Noise, clearings: Sequence[tuple[float, float]]) -> Terrain:
    """Return the seabed of a seed, with no boulders around the clearings (x, y)."""
    grid = GROUND
    sand = _sand(grid, noise)
    height, tint = sand.copy(), np.zeros_like(sand)
    rough = noise.field(grid, None, (0.4, 0.2, 0.1, 0.05), 1)
    rng, axes = np.random.default_rng([seed, 2]), grid.axes()
    for boulder in _scatter(rng, clearings):
        _place(boulder, axes, sand, rough, height, tint, rng)
    reef = smoothstep(sand, 0.3, 1.2)
    height += 0.05 * reef * rough  # the reef itself is rugged rock
    return Terrain(grid, height, np.maximum(height - sand, 0) + 0.1 * reef, tint)


def _sand(grid: Grid, noise: Noise) -> Array:
    """Return a gently wavy floor, rising by some metres in a bay around the origin: no camera sees the horizon."""
    x, y = grid.axes()
    across = y[:, None] + 0.05 * x[None, :] ** 2 + 0.6 * noise.field(grid, None, (3.0, 1.5), 2)
    ramp = np.maximum(across - 2.6, 0)
    rise = 0.2 * ramp**2 / (1 + 0.15 * ramp) + 0.02 * ramp
    rise *= 1 + 0.12 * noise.field(grid, None, (1.5, 0.8, 0.4), 3)
    return np.asarray(rise + 0.06 * noise.field(grid, None, (2.5, 1.2, 0.6, 0.3), 4, gain=0.5), dtype=np.float32)


def _scatter(rng: np.random.Generator, clearings: Sequence[tuple[float, float]]) -> Iterator[_Boulder]:
    """Yield boulders, more of them towards the reef, large before small."""
    for count, smallest, largest, keep_off in _TIERS:
        placed = 0
        while placed < count:
            x = rng.uniform(GROUND.x0, GROUND.x0 + GROUND.width)
            y = GROUND.y0 + GROUND.length * rng.power(1.6)
            radius = smallest * (largest / smallest) ** rng.uniform()
            near = min(math.hypot(x - cx, y - cy) for cx, cy in clearings)
            # The corridor along which the camera comes holds only low rubble.
            corridor = radius > 0.15 and y < 0.8 and abs(x) < keep_off - 0.4 * y * (y < 0)
            if near > _CLEARING_M + radius and math.hypot(x, y) > keep_off and not corridor:
                placed += 1
                yield _Boulder(x, y, radius)


def _place(
    boulder: _Boulder,
    axes: tuple[Array, Array],
    sand: Array,
    rough: Array,
    height: Array,
    tint: Array,
    rng: np.random.Generator,
) -> None:
    """Raise height to a boulder: a rough dome cut by random planes, as broken rock is. axes: the grid's x and y, m."""
    r = boulder.radius
    turn, flat, stretch, sink, hue = _LEAST + _SPAN * rng.random(5)
    angle, slope, level = (_LEAST_CUT + _SPAN_OF_CUTS * rng.random((5, 3))).T[..., None, None]
    x, y = axes
    columns = slice(*np.searchsorted(x, (boulder.x - 1.4 * r, boulder.x + 1.4 * r)))
    rows = slice(*np.searchsorted(y, (boulder.y - 1.4 * r, boulder.y + 1.4 * r)))
    here = (rows, columns)
    if not sand[here].size:
        return
    u, v = ((x[columns] - boulder.x) / r)[None, :], ((y[rows] - boulder.y) / r)[:, None]
    u, v = np.cos(turn) * u + np.sin(turn) * v, (np.cos(turn) * v - np.sin(turn) * u) / stretch
    beyond = (u * u + v * v) * (1 + 0.12 * rough[here])
    dome = np.maximum(1 - beyond, 0)
    cuts = level + slope * (1 - np.cos(angle) * u - np.sin(angle) * v) - 0.3 * slope
    dome = np.minimum(dome, cuts.min(axis=0))
    dome = flat * r * dome * (1 + 0.06 * rough[here]) - sink * flat * r
    top = np.where(beyond < 1, sand[here].mean() + dome, -np.inf)
    higher = top > height[here]
    height[here][higher] = top[higher]
    tint[here][higher] = hue


def height_at(terrain: Terrain, x: float, y: float) -> float:
    """Return the ground's height at the nearest cell, metres."""
    rows, columns = terrain.grid.shape
    row = int((y - terrain.grid.y0) / terrain.grid.cell)
    column = int((x - terrain.grid.x0) / terrain.grid.cell)
    return float(terrain.height[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)])


def triangles(terrain: Terrain) -> tuple[Array, np.ndarray, np.ndarray]:
    """Return vertices (V, 3) float32, triangles (T, 3) uint32 facing up, and the ground (T, 2) they lie on, metres."""
    x, y = terrain.grid.axes()
    vertices = np.stack([*np.meshgrid(x, y), terrain.height], axis=-1).reshape(-1, 3)
    corner = np.arange(vertices.shape[0], dtype=np.uint32).reshape(terrain.grid.shape)
    a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]))
    faces = np.concatenate([np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)])
    return vertices, faces, vertices[faces[:, 0], :2]
