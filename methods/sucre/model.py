"""SUCRe's model of one colour channel in water (eq. 6), and its derivatives.

    I = J a + b,    a = exp(-beta z),    b = B (1 - exp(-gamma z))

I: observed intensity; J: intensity without water; z: distance in metres; B: veiling light, an intensity; beta,
gamma: attenuation and backscatter in 1/m. The functions take arrays of NumPy, PyTorch or JAX, and scalars or arrays
of the same library for the parameters, broadcast as usual.
"""

from __future__ import annotations

import sys
from typing import Any

__all__ = ["derivatives", "predict", "transmission", "veil"]


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
    """The module with exp and expm1 for an array; PyTorch lacks the array-API's own answer."""
    if hasattr(array, "__array_namespace__"):
        return array.__array_namespace__()
    return sys.modules[type(array).__module__.partition(".")[0]]
