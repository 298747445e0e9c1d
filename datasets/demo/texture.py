"""What the seabed and the charts are painted with: flat pictures in metres, with coarser copies for far views.

A far pixel covers many texels. Taking one of them would give each view its own random choice, and the same point
would change colour from view to view; so a pixel is the mean of samples over its own area, taken from the copy whose
texels are as large as the samples' spacing.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from sucre_bench.datasets.demo.noise import Grid, Noise, smoothstep
from sucre_bench.datasets.demo.terrain import Terrain
from sucre_bench.scene import Array

__all__ = ["Texture", "make_texture", "paint_seabed", "sample"]

_SAMPLES = 3  # a pixel is the mean of 3 x 3 samples
_LEVELS = 7
_BAND_ROWS = 128  # of the seabed painted at once: what is worked on stays in the processor's cache

# Albedos, gamma-encoded sRGB: natural seabed colours, chosen by eye.
_SAND, _SHELL = (0.72, 0.65, 0.53), (0.90, 0.87, 0.80)
_ROCK_DARK, _ROCK_LIGHT = (0.34, 0.29, 0.26), (0.66, 0.59, 0.50)
_TURF, _WEED = (0.45, 0.42, 0.22), (0.27, 0.34, 0.15)
_CORALLINE, _SOFT_CORAL = (0.66, 0.42, 0.47), (0.50, 0.38, 0.52)
_RED_SPONGE, _YELLOW_SPONGE = (0.76, 0.30, 0.18), (0.80, 0.66, 0.26)


@dataclass(frozen=True, eq=False)
class Texture:
    """A flat picture and its coarser copies.

    levels: (h, w, 3) uint16 gamma-encoded / 65535, each half as fine as the one before; texel: metres, of the first;
    origin: (2,) metres, the corner of the first texel; axes: (2, 3), world point -> the picture's two metres.
    """

    levels: tuple[np.ndarray, ...]
    texel: float
    origin: Array
    axes: Array

    def covers(self, at: Array) -> np.ndarray:
        """Whether the picture reaches to points (P, 2) in its metres: (P,) bool."""
        rows, columns = self.levels[0].shape[:2]
        return np.asarray(
            ((at > self.origin) & (at < self.origin + self.texel * np.array([columns, rows]))).all(axis=1)
        )


def make_texture(albedo: Array, texel: float, origin: Array, axes: Array) -> Texture:
    """Return the texture of an albedo (h, w, 3) in [0, 1], row 0 at the origin."""
    import cv2

    levels = [(albedo * 65535 + 0.5).astype(np.uint16)]
    while len(levels) < _LEVELS and min(levels[-1].shape[:2]) >= 8:
        fine = levels[-1][: levels[-1].shape[0] // 2 * 2, : levels[-1].shape[1] // 2 * 2]
        levels.append(cv2.resize(fine, (fine.shape[1] // 2, fine.shape[0] // 2), interpolation=cv2.INTER_AREA))
    return Texture(tuple(levels), texel, np.asarray(origin, dtype=np.float32), np.asarray(axes, dtype=np.float32))


def sample(texture: Texture, at: Array, right: Array, down: Array) -> Array:
    """Return the mean colour (P, 3) float32 over parallelograms of the picture.

    at: (P, 2) centres; right, down: (P, 2) sides, all in the picture's metres.
    """
    import cv2

    spacing = np.maximum(np.linalg.norm(right, axis=1), np.linalg.norm(down, axis=1)) / _SAMPLES
    level = np.log2(np.maximum(spacing / texture.texel, 1)).round().clip(0, len(texture.levels) - 1).astype(np.int8)
    colour = np.zeros((len(at), 3), dtype=np.float32)
    offsets = (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5
    for fineness, picture in enumerate(texture.levels):
        (here,) = np.nonzero(level == fineness)
        # cv2 wants maps of less than 32,768 rows and columns, and counts from texel centres
        scale = 1 / (texture.texel * 2**fineness)
        for rows in np.array_split(here, len(here) // 30_000 + 1) if len(here) else ():
            start, u, v = (at[rows] - texture.origin) * scale - 0.5, right[rows] * scale, down[rows] * scale
            total = np.zeros((len(rows), 1, 3), dtype=np.float32)
            for a in offsets:
                for b in offsets:
                    where = (start + np.float32(a) * u + np.float32(b) * v)[:, None, :]
                    total += cv2.remap(picture, where, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
            colour[rows] = total[:, 0] / (65535 * _SAMPLES**2)
    return colour


def paint_seabed(terrain: Terrain, noise: Noise, grid: Grid) -> Texture:
    """Return the seabed's texture over a grid: sand, rock and what grows on it.

    It is shaded as by even light from above on a matt surface: that belongs to the surface and looks the same from
    everywhere, as the colour model requires.
    """
    shade = _shade(terrain)
    bands = list(grid.bands(_BAND_ROWS))
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        painted = list(pool.map(lambda band: _paint(terrain, shade, noise, band), bands))
    return make_texture(np.concatenate(painted), grid.cell, (grid.x0, grid.y0), np.eye(2, 3))


def _paint(terrain: Terrain, shade: Array, noise: Noise, band: Grid) -> Array:
    """Return the albedo of a band of the ground, shaded: (rows, columns, 3) float32."""
    grid = band.padded(1)  # for the slopes at its edges
    z, rock, tint, shade = (_over(grid, terrain.grid, of) for of in (terrain.height, terrain.rock, terrain.tint, shade))
    fine = noise.field(grid, z, (0.064, 0.032, 0.016, 0.008), 11, gain=0.95)
    broad = noise.field(grid, z, (0.8, 0.4, 0.2, 0.1), 12, gain=0.75)
    growth = noise.field(grid, z, (0.6, 0.3, 0.15, 0.07, 0.035), 13, gain=0.65) + 0.2 * fine
    spots = noise.field(grid, z, (0.16, 0.08, 0.04), 14) + 0.15 * fine
    rocky = smoothstep(rock + 0.006 * fine, 0.008, 0.022)

    albedo = np.empty((*grid.shape, 3), dtype=np.float32)
    albedo[:] = _SAND
    albedo *= (1 + 0.05 * broad + 0.06 * fine)[..., None]
    _blend(albedo, _SHELL, 0.8 * smoothstep(fine + 0.5 * spots, 2.2, 2.6))
    stone = (0.5 + 0.16 * broad + 0.15 * fine + 0.25 * tint).clip(0, 1)[..., None]
    albedo += rocky[..., None] * (stone * np.float32(_ROCK_LIGHT) + (1 - stone) * np.float32(_ROCK_DARK) - albedo)
    _blend(albedo, _TURF, rocky * smoothstep(growth, 0.2, 0.9))
    _blend(albedo, _CORALLINE, rocky * smoothstep(-growth, 0.9, 1.3))
    _blend(albedo, _WEED, 0.8 * (1 - rocky) * smoothstep(growth, 1.3, 1.7))
    _blend(albedo, _RED_SPONGE, rocky * smoothstep(spots + 0.5 * broad, 1.7, 1.9))
    _blend(albedo, _YELLOW_SPONGE, rocky * smoothstep(0.5 * broad - spots, 1.8, 2.0))
    _blend(albedo, _SOFT_CORAL, rocky * smoothstep(spots - broad, 2.2, 2.4))
    shade *= 1 + 0.06 * fine + _relief(fine * (0.5 + 0.5 * rocky), grid.cell)
    albedo *= shade[..., None]
    return albedo[1:-1, 1:-1].clip(0.02, 0.97)


def _over(grid: Grid, coarse: Grid, values: Array) -> Array:
    """Return values on the coarse grid as seen on another."""
    import cv2

    scale = grid.cell / coarse.cell
    shift = ((grid.x0 - coarse.x0) / coarse.cell, (grid.y0 - coarse.y0) / coarse.cell)
    warp = np.array([[scale, 0, shift[0] + scale / 2 - 0.5], [0, scale, shift[1] + scale / 2 - 0.5]])
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(values, warp, grid.shape[::-1], flags=flags, borderMode=cv2.BORDER_REPLICATE))


def _blend(albedo: Array, colour: tuple[float, ...], cover: Array) -> None:
    albedo += cover[..., None] * (np.float32(colour) - albedo)


def _shade(terrain: Terrain) -> Array:
    """Return how much of an even sky each cell of the seabed sees, about 0.3 to 1.15."""
    import cv2

    height, cell = terrain.height, terrain.grid.cell
    dy, dx = np.gradient(height, cell)
    facing = (1 - 0.15 * dx + 0.1 * dy) / np.sqrt(1 + dx * dx + dy * dy)
    hollow = sum(((height - cv2.GaussianBlur(height, (0, 0), s / cell)) / s).clip(-0.6, 0.6) for s in (0.05, 0.15, 0.5))
    return np.asarray((0.45 + 0.52 * facing.clip(0.1, 1.2) + 0.45 * hollow).clip(0.3, 1.15), dtype=np.float32)


def _relief(bumps: Array, cell: float) -> Array:
    """Return how light from one side brings out bumps (deviations, of some millimetres each), about zero mean."""
    dy, dx = np.gradient(bumps, cell)
    return np.asarray((0.0022 * (dx + 0.6 * dy)).clip(-0.35, 0.35))
