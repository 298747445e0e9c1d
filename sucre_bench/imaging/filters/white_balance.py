"""Balancing the channels: red lifted from green, gray world, and means brought to mid gray."""

from __future__ import annotations

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.display import gray_world_gain

__all__ = ["gray_world", "mid_gray_gain", "red_from_green"]


def red_from_green(rgb: Array, strength: float = 1.0) -> Array:
    """Return the image with red lifted where green is strong: R + strength (mean G - mean R) (1 - R) G.

    Ancuti et al. 2018, eq. 4. Where red is not the weaker of the two in the mean, the image is as it was.
    """
    red, green = rgb[..., 0], rgb[..., 1]
    lacking = max(0.0, float(green.mean(dtype=np.float64) - red.mean(dtype=np.float64)))
    lifted = red + np.float32(strength * lacking) * (1 - red) * green
    return np.stack([lifted, green, rgb[..., 2]], axis=-1)


def gray_world(rgb: Array) -> Array:
    """Return the image, channels scaled to equal means (Buchsbaum 1980), cut at 1; a black channel stays black."""
    gain = gray_world_gain(rgb.reshape(-1, 3)).astype(np.float32)
    return np.minimum(rgb * gain, 1)


def mid_gray_gain(rgb: Array, ahead: float = 0.0) -> Array:
    """Return the (3,) float32 factors that bring each channel's mean to 0.5 + ahead * mean; 1 for a black channel."""
    mean = rgb.mean(axis=(0, 1), dtype=np.float64)
    there = mean > 1e-6
    return np.where(there, 0.5 / np.where(there, mean, 1) + ahead, 1).astype(np.float32)
