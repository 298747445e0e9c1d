"""The dark channel (He, Sun & Tang 2011), and the greatest value of a neighbourhood."""

import numpy as np

from sucre_bench.arrays import Array


def dark_channel(channels: Array, size: int) -> Array:
    """Return (H, W): the least value of any of the channels (H, W, C) in a window of size x size pixels, size odd.

    Windows are cut at the border.
    """
    import cv2

    darkest = np.ascontiguousarray(channels.min(axis=-1), dtype=np.float32)
    return np.asarray(cv2.erode(darkest, np.ones((size, size), np.uint8)))


def window_max(plane: Array, size: int) -> Array:
    """Return the greatest value (H, W) in each pixel's window, cut at the border."""
    import cv2

    return np.asarray(cv2.dilate(np.ascontiguousarray(plane, dtype=np.float32), np.ones((size, size), np.uint8)))
