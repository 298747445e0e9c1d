"""SUCRe's model of one colour channel in water (eq. 6), its nine parameters, and the least-squares problem in these.

    I = J a + b,    a = exp(-beta z),    b = B (1 - exp(-gamma z))

I: observed intensity; J: intensity without water; z: distance in metres; B: veiling light, an intensity; beta,
gamma: attenuation and backscatter in 1/m. The functions take arrays of NumPy, PyTorch or JAX, and scalars or arrays
of the same library for the parameters, broadcast as usual.

Eliminated colours. SUCRe's eq. 7 minimises sum r^2 with r = I - J a - b, for each channel over B, beta, gamma and one J
a pixel. Given the water, J_p = sum a (I - b) / sum a^2 over the observations of pixel p. Putting that back leaves a
problem in three unknowns a channel (variable projection, Golub & Pereyra 1973). With D = dI/d(B, beta, gamma) and the
part of D that no change of J_p can imitate, D' = D - a (sum a D) / (sum a^2), it has

    g = sum D'^T r,    cost = sum r^2,    H = sum D'^T D',
    K = H + the terms that r multiplies: half the second derivatives of the cost.

H step = g is its Gauss-Newton step, K step = g Newton's. In images r is large beside what D' tells of B and gamma, so
that K is up to 100 times H, and 150 Gauss-Newton steps do what 10 of Newton's do. The sums are over all pixels, so the
systems of several images in one water add up.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Mask

# No water scatters this many times more than it attenuates (Jerlov's types: a factor of 2).
_IMPLAUSIBLE = 5.0

# The least sum of w a^2 that is divided by, of float32's normal numbers. A pixel without any weight has less: J = 0.
LEAST = 2.0**-126

# Slopes by B, and by one coefficient that is beta and gamma, from those by B, beta, gamma.
TIED = np.array([[1, 0, 0], [0, 1, 1], [0, 0, 0]])


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

    @property
    def is_implausible(self) -> Mask:
        """The channels (3,) bool that scatter far more than they attenuate."""
        return np.asarray(self.gamma > _IMPLAUSIBLE * self.beta)

    def columns(self) -> tuple[Array, Array, Array]:
        """Return B, beta, gamma as (3, 1), to be broadcast over observations (3, N)."""
        return self.B[:, None], self.beta[:, None], self.gamma[:, None]


@dataclass(frozen=True, slots=True, eq=False)
class ReducedSystem:
    """The reduced problem around one water, for C channels with n parameters each.

    These are B, beta, gamma, or more (light.py).
    """

    H: Array
    """Of Gauss and Newton, (C, n, n) float64."""

    g: Array
    """Minus half the gradient of the cost, (C, n) float64."""

    cost: Array
    """Shape (C,), float64."""

    K: Array
    """Half the second derivatives of the cost, (C, n, n) float64."""

    def __add__(self, other: ReducedSystem) -> ReducedSystem:
        return ReducedSystem(
            self.H + other.H, self.g + other.g, self.cost + other.cost, self.K + other.K
        )

    def where(self, which: Mask, other: ReducedSystem) -> ReducedSystem:
        """Return this system of some channels, (C,) bool, and another's of the others."""
        return ReducedSystem(
            np.where(which[:, None, None], self.H, other.H),
            np.where(which[:, None], self.g, other.g),
            np.where(which, self.cost, other.cost),
            np.where(which[:, None, None], self.K, other.K),
        )

    def tied(self) -> ReducedSystem:
        """Return the system of gamma = beta: a step of beta is one of both, and gamma has none of its own."""
        H, K = (TIED @ of_three @ TIED.T for of_three in (self.H, self.K))
        return ReducedSystem(H, self.g @ TIED.T, self.cost, K)


def transmission(z: Any, beta: Any) -> Any:
    """Return a, the share of light that comes through."""
    return library_of(z).exp(-beta * z)


def veil(z: Any, B: Any, gamma: Any) -> Any:
    """Return b, the light that the water adds."""
    return B * -library_of(z).expm1(-gamma * z)


def inverted(I: Any, z: Any, parameters: Iterable[Any], least: float) -> tuple[Any, Any]:
    """Return J of observations by themselves, (I - b) / a, and a, which counts as `least` at least.

    parameters: B, beta, gamma.
    """
    B, beta, gamma = parameters
    a = transmission(z, beta).clip(min=least)
    return (I - veil(z, B, gamma)) / a, a


def derivatives(J: Any, z: Any, B: Any, beta: Any, gamma: Any) -> tuple[Any, Any, Any, Any]:
    """Return dI/dJ = a, dI/dB = 1 - exp(-gamma z), dI/dbeta = -z J a, dI/dgamma = B z exp(-gamma z).

    I is linear in J and B, so that I = J dI/dJ + B dI/dB.
    """
    a = transmission(z, beta)
    D_B = veil(z, 1, gamma)
    return a, D_B, -z * (J * a), B * z * (1 - D_B)


def eliminated(x: Any, y: Any, axis: int, v: Any = None) -> tuple[Any, Any, Any]:
    """Return A = sum v x^2, the colour J = sum v x y / A, and the residuals r = y - x J of each pixel.

    x, y: root of the weight times a, and times I - b, over the observations of a pixel along an axis, which A and J
    keep with size 1. v: (...) robust part of the weight, 1 by default.
    """
    vx = x if v is None else v * x
    A = (vx * x).sum(axis, keepdims=True)
    J = (vx * y).sum(axis, keepdims=True) / A.clip(min=LEAST)
    return A, J, y - x * J


def library_of(array: Any) -> Any:
    """Return the module that computes with an array; PyTorch arrays do not name theirs."""
    if hasattr(array, "__array_namespace__"):
        return array.__array_namespace__()
    return sys.modules[type(array).__module__.partition(".")[0]]
