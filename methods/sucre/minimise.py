"""Newton's method on a few bounded parameters, for several independent problems side by side.

It knows nothing of images: `evaluate` returns the system of every problem at given parameters (model.py). Each step
minimises the quadratic model inside the bounds (see `_steps`). Where the cost is not convex, the model is lifted until
it is (`_lift`). Steps are damped, by Nielsen's rule (1999): the damping falls smoothly with how well the model
predicted the gain, and rises faster after every failure. After each step, parameters that enter linearly go to their
optimum for the others (`settled`; Ruhe & Wedin 1980).
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

# Added to a matrix of unit diagonal, so that parameters of which only a combination matters have a step; and besides
# the lift of one that is not convex.
_SINGULAR, _CONVEX = 1e-12, 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """lower, upper: (n,), the range of each parameter; linear: (n,) bool, those that enter linearly.

    Of two linear ones no best value depends on the other's.
    """

    lower: Array
    upper: Array
    linear: Mask

    def held(self, at: Array, g: Array) -> Mask:
        """The parameters (C, n) at a bound that the cost pushes out."""
        return ((at <= self.lower) & (g < 0)) | ((at >= self.upper) & (g > 0))


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
    most: int = 100,
) -> Minimum:
    """Lower the cost of each problem from start (C, n) until a step promises less than tolerance (cost + floor).

    evaluate: parameters (C, n) -> ReducedSystem; floor: a cost that is only rounding; most: how many evaluations.
    """
    n_evaluations = 0

    def settled(at: Array, below: Any) -> tuple[Array, ReducedSystem]:
        """Evaluate, with linear parameters at their best where that matters and can bring the cost below a limit."""
        nonlocal n_evaluations
        system = evaluate(at)
        n_evaluations += 1
        curve = np.einsum("cii->ci", system.H)
        is_free = bounds.linear & (curve > 0)
        moved = np.divide(system.g, curve, out=np.zeros_like(at), where=is_free)
        moved = np.clip(at + moved, bounds.lower, bounds.upper) - at
        gain = (2 * system.g * moved - curve * moved**2).sum(axis=1)
        matters = gain > tolerance * (system.cost + floor)
        if not (matters & (system.cost - gain < below)).any():
            return at, system
        best = evaluate(at + moved)
        n_evaluations += 1
        lower = best.cost < system.cost
        return np.where(lower[:, None], at + moved, at), best.where(lower, system)

    steps_inside = functools.partial(compiled(_steps), bounds.lower, bounds.upper)
    at, system = settled(np.clip(start, bounds.lower, bounds.upper), np.inf)
    damping, growth = np.full(len(at), _FIRST_DAMPING), np.full(len(at), 2.0)
    better = np.ones(len(at), dtype=bool)
    while True:
        if better.any():
            size, lift = _lift(system, ~bounds.held(at, system.g))
            # A short damped step is no convergence.
            last, most_gain = steps_inside(at, system.K, system.g, size, lift)
        promised_little = most_gain <= tolerance * (system.cost + floor)
        converged = promised_little | (damping >= _STUCK)
        if converged.all() or n_evaluations > most:
            break
        steps, promised = steps_inside(at, system.K, system.g, size, lift + damping)
        trial = np.where(converged[:, None], at, np.clip(at + steps, bounds.lower, bounds.upper))
        trial, tried = settled(trial, np.where(converged, -np.inf, system.cost))
        gain = (system.cost - tried.cost) / np.maximum(promised, np.finfo(float).tiny)
        better = (gain > 0) & ~converged
        damping = np.where(
            better,
            damping * np.maximum(1 / 9, 1 - (2 * gain.clip(0, 1) - 1) ** 3),
            damping * growth,
        )
        growth = np.where(better, 2.0, 2 * growth)
        at = np.where(better[:, None], trial, at)
        system = tried.where(better, system)
        damping = damping.clip(max=_STUCK)
    at = np.clip(at + np.where(promised_little[:, None], last, 0), bounds.lower, bounds.upper)
    free = ~bounds.held(at, system.g) & (np.einsum("cii->ci", system.H) > 0)
    return Minimum(at, system, free, n_evaluations - 1, converged)


def _lift(system: ReducedSystem, free: Mask) -> tuple[Array, Array]:
    """Return the size (C, n) of each parameter's curvature, and by how much (C,) of it K is lifted to be convex.

    free: (C, n) bool, parameters that no bound holds. The size of one that nothing depends on is 0.
    """
    of_H, of_K = (np.einsum("cii->ci", each) for each in (system.H, system.K))
    size = np.where(of_H > 0, np.maximum(of_H, np.abs(of_K)), 0)
    known = free & (size > 0)
    scale = np.divide(1, np.sqrt(size), out=np.zeros_like(size), where=known)
    scaled = system.K * scale[:, :, None] * scale[:, None, :]
    scaled += np.eye(size.shape[1]) * ~known[:, None, :]
    lowest = np.linalg.eigvalsh(scaled)[:, 0]
    return size, np.where(lowest < 0, -1.1 * lowest + _CONVEX, 0)


def _steps(lower: Any, upper: Any, at: Any, K: Any, g: Any, size: Any, damping: Any) -> Any:
    """Return the step s (C, n) of each problem to the minimum of its damped quadratic model inside the bounds.

    Also by how much (C,) each lowers the model: 2 g^T s - s^T K s. size: (C, n), see `_lift`. numba compiles it.

    With the scale S = size^-1/2 and A = S K S + damping, s = S t solves

        min_t  t^T A t - 2 (S g)^T t    subject to    lower <= at + S t <= upper

    by active sets (Stark & Parker 1995). A parameter that reaches its bound is held there. Of those that would rather
    leave it, one is let free at a time. Parameters that nothing depends on (size 0) stay.
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
        greatest = 0.0
        for k in range(n):
            known[k] = size[c, k] > 0
            scale[k] = 1 / np.sqrt(size[c, k]) if known[k] else 0.0
            low[k] = (lower[k] - at[c, k]) / scale[k] if known[k] else -np.inf
            high[k] = (upper[k] - at[c, k]) / scale[k] if known[k] else np.inf
            b[k] = g[c, k] * scale[k]
            greatest = max(greatest, abs(b[k]))
            free[k] = known[k]
            t[k] = 0.0
        for i in range(n):
            for j in range(n):
                A[i, j] = K[c, i, j] * scale[i] * scale[j]
            A[i, i] += damping[c] + _SINGULAR
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
                promised[c] -= steps[c, i] * K[c, i, j] * steps[c, j]
    return steps, promised
