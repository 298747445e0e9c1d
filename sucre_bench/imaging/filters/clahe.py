"""CLAHE: contrast-limited histogram equalisation of an image's lightness (Zuiderveld 1994)."""

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.filters.lab import from_lab, to_lab


def equalised(rgb: Array, clip: float, tiles: int) -> Array:
    """Equalise the lightness within tiles, its slope limited, hue and chroma kept.

    rgb: (H, W, 3), [0, 1]; clip: limit of the histogram, in multiples of its mean; tiles: how many along each side.
    Lightness is taken at 256 levels, for which published values of `clip` are meant.
    """
    import cv2

    lab = to_lab(rgb)
    lightness = np.rint(lab[..., 0] * 2.55).astype(np.uint8)
    lab[..., 0] = cv2.createCLAHE(clip, (tiles, tiles)).apply(lightness) / np.float32(2.55)
    return from_lab(lab)
