"""Damped Gauss-Newton steps on a few bounded parameters, for several independent problems side by side.

It knows nothing of images: `evaluate` gives H, g and the cost of every problem around given parameters. The damping is
Nielsen's (1999): it falls smoothly with how well the linear model foretold the gain, and rises faster after every
failure. A parameter that enters linearly needs none, so that each step takes it to its optimum for the others' step
(Ruhe & Wedin 1980, algorithm 2). Bounds hold for the
model's minimum, not for its result.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.methods.sucre.reduced import ReducedSystem

__all__ = ["Bounds", "Minimum", "minimise"]

_FIRST_DAMPING = 1e-3

# With so much damping no step of any length lowers the cost: it is at its rounding, or at a kink.
_STUCK = 1e12

# Least eigenvalue of a matrix of unit diagonal, so that parameters of which only a combination matters have a step.
_SINGULAR = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """lower, upper: (n,) of each parameter; damped: (n,) bool, the parameters that do not enter linearly."""

    lower: Array
    upper: Array
    damped: Mask


@dataclass(frozen=True, slots=True, eq=False)
class Minimum:
    """Where the steps ended, for C problems.

    at: (C, n); system: there, but for the last step, which gains too little to be evaluated; free: (C, n) bool,
    parameters not held at a bound; steps: evaluations after the first; converged: (C,) bool, whether no step
    promises a relative gain above the tolerance.
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
    """Lower the cost of each problem from start (C, n) until a step promises less than tolerance x (cost + floor).

    evaluate: parameters (C, n) -> ReducedSystem; floor: a cost that is nothing but rounding.
    """
    at = np.clip(start, bounds.lower, bounds.upper)
    system = evaluate(at)
    damping, growth = np.full(len(at), _FIRST_DAMPING), np.full(len(at), 2.0)
    for step_count in range(max_steps + 1):
        last = _steps(at, system, bounds, np.zeros(len(at)))  # full: small ones must not pass for convergence
        promised_little = system.predicted_reduction(last) <= tolerance * (system.cost + floor)
        converged = promised_little | (damping >= _STUCK)
        if converged.all() or step_count == max_steps:
            break
        steps = _steps(at, system, bounds, damping)
        promised = system.predicted_reduction(steps)
        trial = np.where(converged[:, None], at, np.clip(at + steps, bounds.lower, bounds.upper))
        tried = evaluate(trial)
        gain = (system.cost - tried.cost) / np.maximum(promised, np.finfo(float).tiny)
        better = (gain > 0) & ~converged
        damping = np.where(better, damping * np.maximum(1 / 9, 1 - (2 * gain.clip(0, 1) - 1) ** 3), damping * growth)
        growth = np.where(better, 2.0, 2 * growth)
        at = np.where(better[:, None], trial, at)
        system = _chosen(better, tried, system)
        damping = damping.clip(max=_STUCK)
    at = np.clip(at + np.where(promised_little[:, None], last, 0), bounds.lower, bounds.upper)
    return Minimum(at, system, _free(at, system, bounds), step_count, converged)


def _free(at: Array, system: ReducedSystem, bounds: Bounds) -> Mask:
    """(C, n) bool: parameters that are inside their bounds or pushed back inside, and that anything depends on."""
    held = ((at <= bounds.lower) & (system.g < 0)) | ((at >= bounds.upper) & (system.g > 0))
    return np.asarray(~held & (np.einsum("cii->ci", system.H) > 0))


def _steps(at: Array, system: ReducedSystem, bounds: Bounds, damping: Array) -> Array:
    """The step (C, n) to the minimum of each damped linear model inside the bounds."""
    from scipy.optimize import lsq_linear

    steps = np.zeros_like(system.g)
    for c, (H, g) in enumerate(zip(system.H, system.g, strict=True)):
        k = np.flatnonzero(np.diag(H) > 0)
        if not len(k):
            continue
        scale = 1 / np.sqrt(np.diag(H)[k])  # parameters of unlike size: unit diagonal
        A = H[np.ix_(k, k)] * scale[:, None] * scale + np.diag(damping[c] * bounds.damped[k])
        values, vectors = np.linalg.eigh(A)
        sizes = np.sqrt(values.clip(min=_SINGULAR))
        root, towards = sizes[:, None] * vectors.T, vectors.T @ (g[k] * scale) / sizes  # least ||root s - towards||
        step = vectors @ (towards / sizes)
        lower, upper = (bounds.lower[k] - at[c, k]) / scale, (bounds.upper[k] - at[c, k]) / scale
        if ((step < lower) | (step > upper)).any():
            box = (np.minimum(lower, -1e-15), np.maximum(upper, 1e-15))
            step = lsq_linear(root, towards, box, method="bvls").x.clip(lower, upper)
        steps[c, k] = scale * step
    return steps


def _chosen(which: Mask, new: ReducedSystem, old: ReducedSystem) -> ReducedSystem:
    return ReducedSystem(
        np.where(which[:, None, None], new.H, old.H),
        np.where(which[:, None], new.g, old.g),
        np.where(which, new.cost, old.cost),
    )
