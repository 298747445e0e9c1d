"""Flat pictures in metres, with coarser copies for far views: the surfaces of the seabed and the charts.

A far pixel covers many texels. Taking one of them would give each view its own random choice, and the same point
would change colour from view to view; so a pixel is the mean of samples over its own area, taken from the copy whose
texels are as large as the samples' spacing.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sucre_bench.arrays import Array

_SAMPLES = 3  # a pixel is the mean of 3 x 3 samples
_LEVELS = 7


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

    levels: list[np.ndarray] = [(albedo * 65535 + 0.5).astype(np.uint16)]
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
    none: Any = None  # the maps hold both coordinates
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
                    total += cv2.remap(picture, where, none, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
            colour[rows] = total[:, 0] / (65535 * _SAMPLES**2)
    return colour
