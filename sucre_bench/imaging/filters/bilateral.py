"""The bilateral filter: removes noise, keeps edges (Tomasi & Manduchi 1998)."""

import numpy as np

from sucre_bench.arrays import Array

_ACROSS, _SPACE = 5, 3.0  # pixels: of the window, and the spatial standard deviation


def denoised(rgb: Array, noise: float) -> Array:
    """Return the image (H, W, 3) float32 after a bilateral filter; itself where noise is 0.

    noise: standard deviation, in intensity, of the differences of colour that count as noise.
    """
    import cv2

    return np.asarray(cv2.bilateralFilter(rgb, _ACROSS, noise, _SPACE)) if noise else rgb
