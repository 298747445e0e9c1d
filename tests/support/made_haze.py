"""Images whose veiling light and transmission are known, and the images nobody wants."""

from __future__ import annotations

import numpy as np

from sucre_bench import Arrays, Restoration, Scene, View
from sucre_bench.plugins.plugin import Method

NOISE = np.random.default_rng(0).random((24, 32, 3), dtype=np.float32)
UNWANTED = {
    "black": np.zeros_like(NOISE),
    "white": np.ones_like(NOISE),
    "gray": np.full_like(NOISE, 0.5),
    "one colour": np.full_like(NOISE, 0.5) * np.float32([0.1, 0.8, 1]),
    "no red": NOISE * np.float32([0, 1, 1]),
    "no green": NOISE * np.float32([1, 0, 1]),
    "no blue": NOISE * np.float32([1, 1, 0]),
    "only red": NOISE * np.float32([1, 0, 0]),
    "4 x 6": NOISE[:4, :6],
    "1 x 1": NOISE[:1, :1],
    "1 x 9": NOISE[:1, :9],
    "black and white": (NOISE[..., :1] > 0.5).astype(np.float32) * np.ones(3, np.float32),
}


def restored(method: Method, rgb: np.ndarray) -> Restoration:
    view = View("photo.png", Arrays(rgb))
    return method.restore(Scene("photo", [view], frozenset()), view)


def hazy(J: np.ndarray, A: np.ndarray, t: np.ndarray) -> np.ndarray:
    """I = J t + A (1 - t) in float64; t: (H, W) or (H, W, 3)."""
    t = t if t.ndim == 3 else t[..., None]
    return J * t + A * (1 - t)


def tiles(height: int, width: int, side: int, colours: np.ndarray, seed: int) -> np.ndarray:
    """A mosaic (height, width, 3) of square tiles, each of one of the colours (N, 3), by chance."""
    of = np.random.default_rng(seed).integers(0, len(colours), (height // side + 1, width // side + 1))
    return colours[np.kron(of, np.ones((side, side), int))[:height, :width]]


def transmission_of(rgb: np.ndarray, result: Restoration) -> np.ndarray:
    """The transmission (H, W, 3) that a result tells of, t = (I - A) / (J - A), NaN where a colour is about A's."""
    assert result.water is not None
    difference = rgb - result.water.veiling_light
    unclear = np.abs(difference) < 0.02
    return np.where(unclear, np.nan, difference / np.where(unclear, 1, result.image - result.water.veiling_light))
