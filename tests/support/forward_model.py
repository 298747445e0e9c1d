"""How water forms an image, written from the equation alone and sharing no code with what is tested.

    I = J exp(-beta z) + B (1 - exp(-gamma z))          (Akkaynak & Treibitz 2018)

z: distance from the camera, metres; J: colour without water; B: veiling light; beta: attenuation, gamma: backscatter,
1/m. Then what a camera does: noise, quantisation. Seabeds and mosaics in such water, and the images nobody wants.
"""

import math

import numpy as np

from sucre_bench import Arrays, Restoration, Scene, View, Water
from sucre_bench.plugins.plugin import Method


def seen_through(J: float, z: float, B: float, beta: float, gamma: float) -> float:
    """One intensity of one pixel."""
    direct = J * math.exp(-beta * z)
    backscattered = B * -math.expm1(-gamma * z)
    return direct + backscattered


def in_water(J: np.ndarray, z: np.ndarray, water: Water) -> np.ndarray:
    """Intensities (..., 3) float64 of colours J (..., 3) at distances z (...)."""
    channels = zip(
        np.moveaxis(J, -1, 0),
        water.veiling_light,
        water.attenuation,
        water.backscatter,
        strict=True,
    )
    formed = np.frompyfunc(seen_through, 5, 1)
    return np.stack(
        [formed(one, z, B, beta, gamma).astype(np.float64) for one, B, beta, gamma in channels],
        axis=-1,
    )


def photographed(intensity: np.ndarray) -> np.ndarray:
    """Intensities as a camera stores them in 8 bits, float64 in [0, 1]."""
    return np.rint(intensity.clip(0, 1) * 255) / 255


CLEAR = Water(
    np.array([0.06, 0.22, 0.3]), np.array([0.42, 0.14, 0.1]), np.array([0.3, 0.17, 0.13])
)


def random_seabed(seed: int = 0) -> View:
    """Distances rise over the image; every fortieth pixel or so is black; 8 bits. Its reference is J."""
    rng = np.random.default_rng(seed)
    z = np.tile(np.linspace(2.0, 8.0, 160, dtype=np.float32)[:, None], (1, 120))
    J = rng.uniform(0.1, 0.9, (160, 120, 3))
    J[rng.random(z.shape) < 0.025] = 0.002
    return view_in_water(J, z, CLEAR)


def view_in_water(J: np.ndarray, z: np.ndarray, water: Water) -> View:
    """A view, 8 bits, whose reference is J."""
    return View("a.png", Arrays(photographed(in_water(J, z, water)), z, J))


def alone(view: View) -> Scene:
    return Scene("alone", [view], frozenset({"depth"}))


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


def restored_image(method: Method, rgb: np.ndarray) -> np.ndarray:
    return restored(method, rgb).image


def hazy(J: np.ndarray, A: np.ndarray, t: np.ndarray) -> np.ndarray:
    """I = J t + A (1 - t) in float64; t: (H, W) or (H, W, 3)."""
    t = t if t.ndim == 3 else t[..., None]
    return J * t + A * (1 - t)


def tiles(height: int, width: int, side: int, colours: np.ndarray, seed: int) -> np.ndarray:
    """A mosaic (height, width, 3) of square tiles, each of one of the colours (N, 3), by chance."""
    of = np.random.default_rng(seed).integers(
        0, len(colours), (height // side + 1, width // side + 1)
    )
    return colours[np.kron(of, np.ones((side, side), int))[:height, :width]]


def transmission_of(rgb: np.ndarray, result: Restoration) -> np.ndarray:
    """The transmission (H, W, 3) that a result tells of, t = (I - A) / (J - A), NaN where a colour is about A's."""
    difference = rgb - result.water.veiling_light
    unclear = np.abs(difference) < 0.02
    return np.where(
        unclear,
        np.nan,
        difference / np.where(unclear, 1, result.image - result.water.veiling_light),
    )
