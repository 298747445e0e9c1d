"""Encodings of intensities: sRGB gamma, linear, 8 bit."""

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.scene import Encoding


def srgb_decode(encoded: Array) -> Array:
    """sRGB transfer function inverted, [0, 1] -> linear [0, 1] (IEC 61966-2-1); the curve goes on beyond."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((np.maximum(encoded, 0) + 0.055) / 1.055) ** 2.4)


def srgb_encode(linear: Array) -> Array:
    """sRGB transfer function, linear [0, 1] -> [0, 1] (IEC 61966-2-1); the curve goes on beyond."""
    return np.where(linear <= 0.0031308, linear * 12.92, 1.055 * np.maximum(linear, 0) ** (1 / 2.4) - 0.055)


def converted(image: Array, source: Encoding, target: Encoding) -> Array:
    """Return an image in another encoding, "gamma" being sRGB's curve; itself where it is encoded so already."""
    if source == target:
        return image
    return srgb_decode(image) if target == "linear" else srgb_encode(image)


def to_8bit(shown: Array) -> np.ndarray:
    """Round a picture in [0, 1] to uint8; pixels without colour become black (SUCRe's convention)."""
    return np.asarray(np.nan_to_num(shown, nan=0.0).clip(0, 1) * 255 + 0.5).astype(np.uint8)
