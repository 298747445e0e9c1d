"""Levenberg-Marquardt on a few bounded parameters, for several independent problems side by side.

It knows nothing of images: `evaluate` returns H, g and the cost of every problem at given parameters (model.py). Each
step minimises the damped linear model inside the bounds (see `_steps`). The damping is Nielsen's (1999): it falls
smoothly with how well the linear model predicted the gain, and rises faster after every failure. Parameters that enter
linearly are not damped, so each step takes them to their optimum for the step of the others (Ruhe & Wedin 1980,
algorithm 2).
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.machine.compute import compiled
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
    first = evaluate(at)
    # contiguous, as later systems are: numba compiles the steps for each layout
    system = ReducedSystem(*map(np.ascontiguousarray, (first.H, first.g, first.cost)))
    steps_inside = functools.partial(compiled(_steps), bounds.lower, bounds.upper, bounds.damped)
    damping, growth = np.full(len(at), _FIRST_DAMPING), np.full(len(at), 2.0)
    better = np.ones(len(at), dtype=bool)
    last, most_gain = np.zeros_like(at), np.zeros(len(at))
    for step_count in range(max_steps + 1):
        # A short damped step is no convergence. Where nothing moved, the step is the one before.
        steps, promised = steps_inside(at, system.H, system.g, np.zeros(len(at)), better)
        last = np.where(better[:, None], steps, last)
        most_gain = np.where(better, promised, most_gain)
        promised_little = most_gain <= tolerance * (system.cost + floor)
        converged = promised_little | (damping >= _STUCK)
        if converged.all() or step_count == max_steps:
            break
        steps, promised = steps_inside(at, system.H, system.g, damping, ~converged)
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


def _steps(
    lower: Any, upper: Any, damped: Any, at: Any, H: Any, g: Any, damping: Any, which: Any
) -> Any:
    """Return the step s (C, n) of each problem to the minimum of its damped linear model inside the bounds.

    Also by how much (C,) each lowers the cost of the linear model: 2 g^T s - s^T H s. which: (C,) bool, the problems to
    solve; the others get a step of 0. numba compiles it.

    With the scale S = diag(H)^-1/2 and A = S H S + damping diag(damped), s = S t solves

        min_t  t^T A t - 2 (S g)^T t    subject to    lower <= at + S t <= upper

    by active sets (Stark & Parker 1995). A parameter that reaches its bound is held there. Of those that would rather
    leave it, one is let free at a time. Parameters that nothing depends on (H_kk = 0) stay.
    """
    n = at.shape[1]
    steps = np.zeros(at.shape)
    promised = np.zeros(len(at))
    scale = np.zeros(n)
    b = np.zeros(n)
    low = np.zeros(n)
    high = np.zeros(n)
    t = np.zeros(n)
    best = np.zeros(n)
    A = np.zeros((n, n))
    rest = np.zeros((n, n))
    known = np.zeros(n, dtype=np.bool_)
    free = np.zeros(n, dtype=np.bool_)
    for c in range(len(at)):
        if not which[c]:
            continue
        greatest = 0.0
        for k in range(n):
            # sums of squares, which rounding may bring below 0; parameters differ in size
            known[k] = H[c, k, k] > 0
            scale[k] = 1 / np.sqrt(H[c, k, k]) if known[k] else 0.0
            low[k] = (lower[k] - at[c, k]) / scale[k] if known[k] else -np.inf
            high[k] = (upper[k] - at[c, k]) / scale[k] if known[k] else np.inf
            b[k] = g[c, k] * scale[k]
            greatest = max(greatest, abs(b[k]))
            free[k] = known[k]
            t[k] = 0.0
        for i in range(n):
            for j in range(n):
                A[i, j] = H[c, i, j] * scale[i] * scale[j]
            A[i, i] += damping[c] * damped[i] + _SINGULAR
        for _ in range(10 * n):
            # The best t of the free parameters, by elimination above the diagonal; the others keep theirs.
            for i in range(n):
                best[i] = b[i] if free[i] else t[i]
                for j in range(n):
                    rest[i, j] = A[i, j]
                    if free[i] and not free[j]:
                        best[i] -= A[i, j] * t[j]
            for i in range(n):
                for j in range(i + 1, n):
                    if free[i] and free[j]:
                        factor = rest[i, j] / rest[i, i]
                        best[j] -= factor * best[i]
                        for k in range(j, n):
                            rest[j, k] -= factor * rest[i, k]
            for i in range(n - 1, -1, -1):
                if free[i]:
                    for j in range(i + 1, n):
                        if free[j]:
                            best[i] -= rest[i, j] * best[j]
                    best[i] /= rest[i, i]
            first = -1
            share = 1.0
            for k in range(n):
                if free[k] and not low[k] <= best[k] <= high[k]:
                    bound = low[k] if best[k] < low[k] else high[k]
                    reached = (bound - t[k]) / (best[k] - t[k])
                    if first < 0 or reached < share:
                        first = k
                        share = max(reached, 0.0)
            for k in range(n):
                t[k] += share * (best[k] - t[k])
            if first >= 0:
                t[first] = low[first] if best[first] < low[first] else high[first]
                free[first] = False
                continue
            most = 1e-12 * greatest
            for i in range(n):
                pull = b[i]
                for j in range(n):
                    pull -= A[i, j] * t[j]
                if t[i] > low[i]:
                    pull = -pull
                if known[i] and not free[i] and pull > most:
                    first = i
                    most = pull
            if first < 0:
                break
            free[first] = True
        for i in range(n):
            steps[c, i] = scale[i] * t[i]
            # Exactly to a bound: a veil of 1e-17 has a slope by gamma, which a step would take anywhere.
            if t[i] <= low[i]:
                steps[c, i] = lower[i] - at[c, i]
            elif t[i] >= high[i]:
                steps[c, i] = upper[i] - at[c, i]
        for i in range(n):
            promised[c] += 2 * g[c, i] * steps[c, i]
            for j in range(n):
                promised[c] -= steps[c, i] * H[c, i, j] * steps[c, j]
    return steps, promised
