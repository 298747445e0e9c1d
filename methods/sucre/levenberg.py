"""Levenberg-Marquardt on a few bounded parameters, for several independent problems side by side.

This module knows nothing of images: `evaluate` returns H, g and the cost of every problem at given parameters. Each
step minimises the damped linear model inside the bounds (see `_steps`). The damping is Nielsen's (1999): it falls
smoothly with how well the linear model predicted the gain, and rises faster after every failure. Parameters that enter
linearly are not damped, so each step takes them to their optimum for the step of the others (Ruhe & Wedin 1980,
algorithm 2).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.methods.sucre.model import ReducedSystem

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
        damping = np.where(better, damping * np.maximum(1 / 9, 1 - (2 * gain.clip(0, 1) - 1) ** 3), damping * growth)
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
    diagonal = np.einsum("cii->ci", system.H)
    known = diagonal > 0
    scale = np.divide(1, np.sqrt(diagonal), out=np.zeros_like(diagonal), where=known)  # parameters differ in size
    A, b = system.H * scale[:, :, None] * scale[:, None, :], system.g * scale
    np.einsum("cii->ci", A)[:] += np.where(known, damping[:, None] * bounds.damped + _SINGULAR, 1)
    steps = np.where(which[:, None], scale * np.linalg.solve(A, b[..., None])[..., 0], 0)
    beyond = ((at + steps < bounds.lower) | (at + steps > bounds.upper)).any(axis=1)
    for c in np.flatnonzero(beyond):
        k = np.flatnonzero(known[c])
        lower, upper = (bounds.lower[k] - at[c, k]) / scale[c, k], (bounds.upper[k] - at[c, k]) / scale[c, k]
        steps[c, k] = scale[c, k] * _within(A[c][np.ix_(k, k)], b[c, k], lower, upper)
    return steps


def _within(A: Array, b: Array, lower: Array, upper: Array) -> Array:
    """Return the t (n,) of least t^T A t - 2 b^T t inside bounds that contain 0, by active sets (Stark & Parker 1995).

    A parameter that reaches its bound is held there. Of those that would rather leave it, one is let free at a time.
    """
    t, free = np.zeros(len(b)), np.ones(len(b), dtype=bool)
    for _ in range(10 * len(b)):
        best = t.copy()
        best[free] = np.linalg.solve(A[np.ix_(free, free)], b[free] - A[np.ix_(free, ~free)] @ t[~free])
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
