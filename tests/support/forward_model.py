"""How water forms an image, written from the equation alone and sharing no code with what is tested.

    I = J exp(-beta z) + B (1 - exp(-gamma z))          (Akkaynak & Treibitz 2018)

z: distance from the camera, metres; J: colour without water; B: veiling light; beta: attenuation, gamma: backscatter,
1/m. Then what a camera does: noise, quantisation.
"""

from __future__ import annotations

import math

import numpy as np

from sucre_bench import Water


def seen_through(J: float, z: float, B: float, beta: float, gamma: float) -> float:
    """One intensity of one pixel."""
    direct = J * math.exp(-beta * z)
    backscattered = B * -math.expm1(-gamma * z)
    return direct + backscattered


def in_water(J: np.ndarray, z: np.ndarray, water: Water) -> np.ndarray:
    """Intensities (..., 3) float64 of colours J (..., 3) at distances z (...)."""
    channels = zip(np.moveaxis(J, -1, 0), water.veiling_light, water.attenuation, water.backscatter, strict=True)
    formed = np.frompyfunc(seen_through, 5, 1)
    return np.stack([formed(one, z, B, beta, gamma).astype(np.float64) for one, B, beta, gamma in channels], axis=-1)


def photographed(intensity: np.ndarray, *, noise: float = 0.0, bits: int = 8, seed: int = 0) -> np.ndarray:
    """Intensities as a camera stores them, float64 in [0, 1]. noise: standard deviation; bits: 0 for no rounding."""
    noisy = intensity + noise * np.random.default_rng(seed).standard_normal(intensity.shape)
    levels = 2**bits - 1
    return np.rint(noisy.clip(0, 1) * levels) / levels if bits else noisy
