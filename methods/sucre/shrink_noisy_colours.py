"""Shrink noisy colours towards the mean colour of the image (empirical Bayes).

Little light arrives from far away, and dividing by a small transmission magnifies the noise. If the colours of a
channel are normal with mean mu and variance S^2, the posterior mean of a colour with variance v is (Efron & Morris
1973)

    (J / v + mu / S^2) / (1 / v + 1 / S^2),    with variance 1 / (1 / v + 1 / S^2).

mu and S^2 come from the image itself. Each pixel counts with its reliability S^2 / (S^2 + v).
"""

from __future__ import annotations

import numpy as np

from sucre_bench.arrays import Array

__all__ = ["posterior"]

_ROUNDS = 30

# Least variance of an image's colours, .01 squared: with less, all colours would become one.
_LEAST = 1e-4

# The variance of a colour without any information.
_ENDLESS = 1e12


def posterior(J: Array, deviation: Array) -> tuple[Array, Array]:
    """Return the posterior mean and standard deviation (3, P) float32 of colours J with standard deviations, (3, P)."""
    if not np.isfinite(deviation).any():  # the noise is unknown
        return J, deviation
    v = np.where(np.isfinite(deviation), np.square(deviation, dtype=np.float64), _ENDLESS)
    mean, variance = np.median(J, axis=1, keepdims=True).astype(np.float64), np.full((3, 1), 0.05)
    for _ in range(_ROUNDS):
        trust = variance / (variance + v)
        total = trust.sum(axis=1, keepdims=True)
        mean = (trust * J).sum(axis=1, keepdims=True) / total
        variance = ((trust * ((J - mean) ** 2 - v)).sum(axis=1, keepdims=True) / total).clip(min=_LEAST)
    trust = variance / (variance + v)
    return (mean + trust * (J - mean)).astype(np.float32), np.sqrt(trust * v).astype(np.float32)
