"""Saliency: which pixels stand out (Achanta, Hemami, Estrada & Susstrunk 2009)."""

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.filters.lab import to_lab


def saliency(rgb: Array) -> Array:
    """Return (H, W) float32: how far each pixel's smoothed colour is from the image's mean colour, in L*a*b* / 100.

    rgb: (H, W, 3) in [0, 1]. Without the division by the image's maximum that is for display, so that maps of
    two images can be compared; the unit is the distance from black to white.
    """
    lab = to_lab(rgb) / 100
    mean = lab.mean(axis=(0, 1), dtype=np.float64).astype(np.float32)
    return np.asarray(np.linalg.norm(binomial(lab) - mean, axis=-1))


def binomial(image: Array) -> Array:
    """Return the image smoothed by the 5 x 5 binomial kernel (1 4 6 4 1) / 16; (H, W) or (H, W, C) float32.

    Its response falls to a half at pi / 2.75, the cut-off that is named w_hc where it is used.
    """
    import cv2

    kernel = np.array([1, 4, 6, 4, 1], np.float32) / 16
    return np.asarray(cv2.sepFilter2D(image, -1, kernel, kernel))
