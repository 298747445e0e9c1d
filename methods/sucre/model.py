"""SUCRe's model of one colour channel in water (eq. 6), its derivatives, and its nine parameters.

    I = J a + b,    a = exp(-beta z),    b = B (1 - exp(-gamma z))

I: observed intensity; J: intensity without water; z: distance in metres; B: veiling light, an intensity; beta,
gamma: attenuation and backscatter in 1/m. The functions take arrays of NumPy, PyTorch or JAX, and scalars or arrays
of the same library for the parameters, broadcast as usual.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

import numpy as np

from sucre_bench.arrays import Array


@dataclass(frozen=True, slots=True, eq=False)
class WaterParameters:
    """B, beta and gamma of the three channels: (3,) float64 each, in RGB order.

    The solvers vary the three parameters of each channel as one row. `by_channel` and `of_channels` are the only
    places where that layout is made and undone.
    """

    B: Array
    beta: Array
    gamma: Array

    @staticmethod
    def of_channels(rows: Array) -> WaterParameters:
        """Return the parameters from rows (3 channels, 3): B, beta, gamma of each channel."""
        return WaterParameters(*(np.array(rows[:, k], dtype=np.float64) for k in range(3)))

    def by_channel(self) -> Array:
        """Return (3 channels, 3) float64: a row a channel, columns B, beta, gamma."""
        return np.stack([self.B, self.beta, self.gamma], axis=1).astype(np.float64)

    def channel(self, c: int) -> tuple[float, float, float]:
        """Return B, beta and gamma of one channel as plain numbers."""
        return float(self.B[c]), float(self.beta[c]), float(self.gamma[c])

    def columns(self) -> tuple[Array, Array, Array]:
        """Return B, beta, gamma as (3, 1), to be broadcast over observations (3, N)."""
        return self.B[:, None], self.beta[:, None], self.gamma[:, None]


def transmission(z: Any, beta: Any) -> Any:
    """Return a, the share of light that comes through."""
    return _library(z).exp(-beta * z)


def veil(z: Any, B: Any, gamma: Any) -> Any:
    """Return b, the light that the water adds."""
    return B * -_library(z).expm1(-gamma * z)


def predict(J: Any, z: Any, B: Any, beta: Any, gamma: Any) -> Any:
    """Return I."""
    return J * transmission(z, beta) + veil(z, B, gamma)


def derivatives(J: Any, z: Any, B: Any, beta: Any, gamma: Any) -> tuple[Any, Any, Any, Any]:
    """Return dI/dJ = a, dI/dB = 1 - exp(-gamma z), dI/dbeta = -z J a, dI/dgamma = B z exp(-gamma z).

    I is linear in J and B, so that I = J dI/dJ + B dI/dB.
    """
    a = transmission(z, beta)
    D_B = veil(z, 1, gamma)
    return a, D_B, -z * (J * a), B * z * (1 - D_B)


def _library(array: Any) -> Any:
    """Return the module with exp and expm1 for an array; PyTorch arrays do not name theirs."""
    if hasattr(array, "__array_namespace__"):
        return array.__array_namespace__()
    return sys.modules[type(array).__module__.partition(".")[0]]
