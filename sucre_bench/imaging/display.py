"""Encodings, and how a restored image is brought to the screen.

A display normalisation has a name that is kept with each score: "none" clips to [0, 1]; "stretch-1-99" clips
every channel at its percentiles 1 and 99 and maps those to 0 and 1 (SUCRe, sec. 4.2; any two percentiles may be
named); "linear-stretch-1-99" does so in linear light; "gray-world" scales every channel to the mean of all
(Buchsbaum 1980); "white-99" scales every channel so that its percentile 99 becomes 1 (the white patch of Land 1977),
and leaves black where it is.
"""

from __future__ import annotations

import re

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.scene import Encoding

__all__ = ["check_display", "display", "gray_world_gain", "stretch"]


def display(image: Array, how: str, encoding: Encoding = "gamma") -> Array:
    """Return the picture to show and to score: (H, W, 3) float32 in [0, 1], gamma-encoded, NaN where no colour.

    image: (H, W, 3), any range, NaN = no colour, encoded as `encoding` says; how: a normalisation's name.
    Raises InputError for an unknown name.
    """
    check_display(how)
    valid = np.isfinite(image).all(axis=-1)
    shown = np.full(image.shape, np.nan, dtype=np.float32)
    if not valid.any():
        return shown
    pixels: Array = np.asarray(image[valid], dtype=np.float64)  # (P, 3)
    if how == "gray-world":
        pixels = pixels * gray_world_gain(pixels)
    elif how.startswith("white-"):
        pixels = pixels * _white_gain(pixels, float(how.split("-")[1]))
    elif how != "none":
        low, high = (float(p) for p in how.split("-")[-2:])
        if how.startswith("linear-") and encoding == "gamma":
            pixels, encoding = srgb_decode(pixels), "linear"
        pixels = stretch(pixels, low, high)
    pixels = pixels.clip(0, 1)
    shown[valid] = srgb_encode(pixels) if encoding == "linear" else pixels
    return shown


def check_display(how: str) -> None:
    """Raise InputError unless `how` names a display normalisation."""
    white = re.fullmatch(r"white-(\d+(?:\.\d+)?)", how)
    if white and 0 < float(white[1]) <= 100:
        return
    parts = re.fullmatch(r"(?:linear-)?stretch-(\d+(?:\.\d+)?)-(\d+(?:\.\d+)?)", how)
    if how in ("none", "gray-world") or (parts and 0 <= float(parts[1]) < float(parts[2]) <= 100):
        return
    known = "none, gray-world or stretch-LOW-HIGH such as stretch-1-99, linear-stretch-1-99 in linear light, white-99"
    raise InputError(f"display '{how}': unknown; use {known}")


def stretch(image: Array, low: float = 1, high: float = 99, over: Array | None = None) -> Array:
    """Map each channel's percentiles low and high to 0 and 1, clipped; a constant channel is only clipped.

    image: (..., 3); over: (P, 3) pixels to take the percentiles of, default the image's own.
    """
    bottom, top = np.percentile(image.reshape(-1, 3) if over is None else over, [low, high], axis=0)
    flat = top - bottom < 1e-6
    scaled = (image - np.where(flat, 0, bottom)) / np.where(flat, 1, top - bottom)
    return np.asarray(scaled.clip(0, 1))


def gray_world_gain(pixels: Array) -> Array:
    """Return the (3,) factors that bring each channel's mean (P, 3) to that of all; 1 for one that is not positive."""
    mean = pixels.mean(axis=0, dtype=np.float64)
    usable = mean > 1e-6
    return np.asarray(np.where(usable, mean.mean() / np.where(usable, mean, 1), 1))


def _white_gain(pixels: Array, high: float) -> Array:
    """The (3,) factors that bring a percentile of each channel (P, 3) to 1; 1 for one that is not positive."""
    top = np.percentile(pixels, high, axis=0)
    usable = top > 1e-6
    return np.asarray(np.where(usable, 1 / np.where(usable, top, 1), 1))
