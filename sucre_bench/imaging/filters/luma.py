"""Luma: the brightness of gamma-encoded colours (ITU-R BT.601)."""

import numpy as np

from sucre_bench.arrays import Array


def luma(rgb: Array) -> Array:
    """Return 0.299 R + 0.587 G + 0.114 B, (H, W) float32; rgb: (H, W, 3) float32. A gray pixel keeps its value."""
    import cv2

    return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY))
