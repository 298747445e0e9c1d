"""Residuals of observations, their leverages and their information."""

from __future__ import annotations

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.methods.sucre.model import WaterParameters, transmission, veil
from sucre_bench.multiview.observations import Observations

# The least transmission: less light says nothing about a colour, and its square would be no number in float32.
_DARKEST = 1e-6


def residuals_of(
    observations: Observations, J: Array, water: WaterParameters, v: Array | float = 1.0
) -> tuple[Array, Array, Array, Array]:
    """Return of observations the residuals sqrt(w) (I - J a - b), leverages h, information w a^2, and J a + b.

    All are (3, N), of the type of J (3, P). v: (3, N), robust parts of the weights. h = v w a^2 / sum v w a^2 over the
    pixel, so that r has the variance of the noise times 1 - h.
    """
    place = observations.place
    z, everything = observations.distance.astype(J.dtype), slice(None)
    B, beta, gamma = (column.astype(J.dtype) for column in water.columns())
    a = transmission(z, beta)
    information = information_of(observations, a, everything)
    I = observations.intensity(everything)
    r = I - J[:, place] * a - veil(z, B, gamma)
    known = v * information
    total = np.zeros_like(J)
    for n, part in observations.slots():
        total[:, :n] += known[:, part]
    total = total[:, place]
    h = np.divide(known, total, out=np.zeros_like(known), where=total > 0)
    root = 1.0 if observations.weight is None else np.sqrt(observations.weight)
    return root * r, h, information, I - r


def information_of(observations: Observations, a: Array, part: slice) -> Array:
    """Return w a^2 (3, n) of observations with transmission a."""
    a = a.clip(min=_DARKEST)
    return np.asarray(
        a * a if observations.weight is None else observations.weight[..., part] * a * a
    )
