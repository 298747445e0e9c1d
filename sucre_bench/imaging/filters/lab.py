"""CIE L*a*b* of gamma-encoded sRGB (D65), and contrast-limited histogram equalisation of its lightness."""

import numpy as np

from sucre_bench.arrays import Array


def to_lab(rgb: Array) -> Array:
    """Return L in [0, 100], a and b about [-110, 110], (H, W, 3) float32, of RGB in [0, 1], clipped."""
    import cv2

    return np.asarray(cv2.cvtColor(np.clip(rgb, 0, 1).astype(np.float32), cv2.COLOR_RGB2Lab))


def from_lab(lab: Array) -> Array:
    """Return RGB (H, W, 3) float32 in [0, 1], colours outside of sRGB clipped."""
    import cv2

    return np.asarray(cv2.cvtColor(np.ascontiguousarray(lab, dtype=np.float32), cv2.COLOR_Lab2RGB)).clip(0, 1)


def equalised(rgb: Array, clip: float, tiles: int) -> Array:
    """Equalise the lightness within tiles, its slope limited (CLAHE, Zuiderveld 1994), hue and chroma kept.

    rgb: (H, W, 3), [0, 1]; clip: limit of the histogram, in multiples of its mean; tiles: how many along each side.
    Lightness is taken at 256 levels, for which published values of `clip` are meant.
    """
    import cv2

    lab = to_lab(rgb)
    lightness = np.rint(lab[..., 0] * 2.55).astype(np.uint8)
    lab[..., 0] = cv2.createCLAHE(clip, (tiles, tiles)).apply(lightness) / np.float32(2.55)
    return from_lab(lab)
