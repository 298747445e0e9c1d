"""SUCRe's model of one colour channel in water (eq. 6), its nine parameters, and the least-squares problem in these.

    I = J a + b,    a = exp(-beta z),    b = B (1 - exp(-gamma z))

I: observed intensity; J: intensity without water; z: distance in metres; B: veiling light, an intensity; beta,
gamma: attenuation and backscatter in 1/m. The functions take arrays of NumPy, PyTorch or JAX, and scalars or arrays
of the same library for the parameters, broadcast as usual.

Eliminated colours. SUCRe's eq. 7 minimises sum r^2 with r = I - J a - b, for each channel over B, beta, gamma and one J
a pixel. Given the water, J_p = sum a (I - b) / sum a^2 over the observations of pixel p. Putting that back leaves a
problem in three unknowns a channel (variable projection, Golub & Pereyra 1973). With D = dI/d(B, beta, gamma) and the
part of D that no change of J_p can imitate, D' = D - a (sum a D) / (sum a^2), its Gauss-Newton system is

    H step = g,    H = sum D'^T D',    g = sum D'^T r,    cost = sum r^2.

The sums are over all pixels, so the systems of several images in one water add up.

`minimise` is Levenberg-Marquardt on a few bounded parameters, for several independent problems side by side.

It knows nothing of images: `evaluate` returns H, g and the cost of every problem at given parameters. Each
step minimises the damped linear model inside the bounds (see `_steps`). The damping is Nielsen's (1999): it falls
smoothly with how well the linear model predicted the gain, and rises faster after every failure. Parameters that enter
linearly are not damped, so each step takes them to their optimum for the step of the others (Ruhe & Wedin 1980,
algorithm 2).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
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

    def channel(self, c: int) -> tuple[float, float, float]:
        """Return B, beta and gamma of one channel as plain numbers."""
        return float(self.B[c]), float(self.beta[c]), float(self.gamma[c])

    @property
    def is_implausible(self) -> Mask:
        """The channels (3,) bool that scatter far more than they attenuate."""
        return np.asarray(self.gamma > _IMPLAUSIBLE * self.beta)

    def columns(self) -> tuple[Array, Array, Array]:
        """Return B, beta, gamma as (3, 1), to be broadcast over observations (3, N)."""
        return self.B[:, None], self.beta[:, None], self.gamma[:, None]


@dataclass(frozen=True, slots=True, eq=False)
class ReducedSystem:
    """The reduced problem around one water, for C channels with n = 3 parameters each: B, beta, gamma.

    H: (C, n, n) float64; g: (C, n) float64, minus half the gradient of the cost; cost: (C,) float64.
    """

    H: Array
    g: Array
    cost: Array

    def __add__(self, other: ReducedSystem) -> ReducedSystem:
        return ReducedSystem(self.H + other.H, self.g + other.g, self.cost + other.cost)

    def tied(self) -> ReducedSystem:
        """Return the system of gamma = beta: a step of beta is one of both, and gamma has none of its own."""
        return ReducedSystem(TIED @ self.H @ TIED.T, self.g @ TIED.T, self.cost)

    def predicted_reduction(self, step: Array) -> Array:
        """Return by how much (C,) a step (C, n) lowers the cost of the linear model."""
        return 2 * (self.g * step).sum(axis=1) - np.einsum("ci,cij,cj->c", step, self.H, step)


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


# -- Levenberg-Marquardt ----------------------------------------------------------------------

_FIRST_DAMPING = 1e-3

# With so much damping no step of any length lowers the cost: it is at its rounding, or at a kink.
_STUCK = 1e12

# Added to a matrix of unit diagonal, so that parameters of which only a combination matters have a step.
_SINGULAR = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """lower, upper: (n,), the range of each parameter; damped: (n,) bool, parameters that do not enter linearly."""

    lower: Array
    upper: Array
    damped: Mask


@dataclass(frozen=True, slots=True, eq=False)
class Minimum:
    """The end of the steps, for C problems.

    at: (C, n) parameters; system: the system one step before, as the last step gains too little to be evaluated;
    free: (C, n) bool, parameters not held at a bound; steps: evaluations after the first; converged: (C,) bool, whether
    no step promises a relative gain above the tolerance.
    """

    at: Array
    system: ReducedSystem
    free: Mask
    steps: int
    converged: Mask


def minimise(
    evaluate: Callable[[Array], ReducedSystem],
    start: Array,
    bounds: Bounds,
    *,
    tolerance: float,
    floor: float = 0.0,
    max_steps: int = 60,
) -> Minimum:
    """Lower the cost of each problem from start (C, n) until a step promises less than tolerance (cost + floor).

    evaluate: parameters (C, n) -> ReducedSystem; floor: a cost that is only rounding.
    """
    at = np.clip(start, bounds.lower, bounds.upper)
    system = evaluate(at)
    undamped = np.zeros(len(at))
    damping, growth = np.full(len(at), _FIRST_DAMPING), np.full(len(at), 2.0)
    last, better = np.zeros_like(at), np.ones(len(at), dtype=bool)
    for step_count in range(max_steps + 1):
        # A short damped step is no convergence. Where nothing moved, the step is the one before.
        last = np.where(better[:, None], _steps(at, system, bounds, undamped, better), last)
        promised_little = system.predicted_reduction(last) <= tolerance * (system.cost + floor)
        converged = promised_little | (damping >= _STUCK)
        if converged.all() or step_count == max_steps:
            break
        steps = _steps(at, system, bounds, damping, ~converged)
        promised = system.predicted_reduction(steps)
        trial = np.where(converged[:, None], at, np.clip(at + steps, bounds.lower, bounds.upper))
        tried = evaluate(trial)
        gain = (system.cost - tried.cost) / np.maximum(promised, np.finfo(float).tiny)
        better = (gain > 0) & ~converged
        damping = np.where(
            better,
            damping * np.maximum(1 / 9, 1 - (2 * gain.clip(0, 1) - 1) ** 3),
            damping * growth,
        )
        growth = np.where(better, 2.0, 2 * growth)
        at = np.where(better[:, None], trial, at)
        H = np.where(better[:, None, None], tried.H, system.H)
        g = np.where(better[:, None], tried.g, system.g)
        system = ReducedSystem(H, g, np.where(better, tried.cost, system.cost))
        damping = damping.clip(max=_STUCK)
    at = np.clip(at + np.where(promised_little[:, None], last, 0), bounds.lower, bounds.upper)
    held = ((at <= bounds.lower) & (system.g < 0)) | ((at >= bounds.upper) & (system.g > 0))
    free = np.asarray(~held & (np.einsum("cii->ci", system.H) > 0))
    return Minimum(at, system, free, step_count, converged)


def _steps(at: Array, system: ReducedSystem, bounds: Bounds, damping: Array, which: Mask) -> Array:
    """Return the step s (C, n) of each problem to the minimum of its damped linear model inside the bounds.

    which: (C,) bool, the problems to solve; the others get a step of 0.

    With the scale S = diag(H)^-1/2 and A = S H S + damping diag(damped), s = S t solves

        min_t  t^T A t - 2 (S g)^T t    subject to    lower <= at + S t <= upper,

    which is A t = S g where no bound is in the way. Parameters that nothing depends on (H_kk = 0) stay.
    """
    # sums of squares, which rounding may bring below 0
    diagonal = np.einsum("cii->ci", system.H).clip(min=0)
    known = diagonal > 0
    # parameters differ in size
    scale = np.divide(1, np.sqrt(diagonal), out=np.zeros_like(diagonal), where=known)
    A, b = system.H * scale[:, :, None] * scale[:, None, :], system.g * scale
    np.einsum("cii->ci", A)[:] += np.where(known, damping[:, None] * bounds.damped + _SINGULAR, 1)
    steps = np.where(which[:, None], scale * np.linalg.solve(A, b[..., None])[..., 0], 0)
    beyond = ((at + steps < bounds.lower) | (at + steps > bounds.upper)).any(axis=1)
    for c in np.flatnonzero(beyond):
        k = np.flatnonzero(known[c])
        lower, upper = (
            (bounds.lower[k] - at[c, k]) / scale[c, k],
            (bounds.upper[k] - at[c, k]) / scale[c, k],
        )
        steps[c, k] = scale[c, k] * _within(A[c][np.ix_(k, k)], b[c, k], lower, upper)
    return steps


def _within(A: Array, b: Array, lower: Array, upper: Array) -> Array:
    """Return the t (n,) of least t^T A t - 2 b^T t inside bounds that contain 0, by active sets (Stark & Parker 1995).

    A parameter that reaches its bound is held there. Of those that would rather leave it, one is let free at a time.
    """
    t, free = np.zeros(len(b)), np.ones(len(b), dtype=bool)
    for _ in range(10 * len(b)):
        best = t.copy()
        best[free] = np.linalg.solve(
            A[np.ix_(free, free)], b[free] - A[np.ix_(free, ~free)] @ t[~free]
        )
        beyond = np.flatnonzero((best < lower) | (best > upper))
        if len(beyond):
            bound = np.where(best < lower, lower, upper)
            shares = (bound - t)[beyond] / (best - t)[beyond]
            first = beyond[shares.argmin()]
            t += shares.min().clip(0, 1) * (best - t)
            t[first], free[first] = bound[first], False
            continue
        t = best
        slope = b - A @ t
        pull = np.where(free, 0, np.where(t <= lower, slope, -slope))
        if pull.max() <= 1e-12 * np.abs(b).max():
            break
        free[pull.argmax()] = True
    return t.clip(lower, upper)
