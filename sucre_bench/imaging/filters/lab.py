"""CIE L*a*b* of gamma-encoded sRGB (D65), by OpenCV. Lab of colour charts (D50) is in `imaging.cielab`."""

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
