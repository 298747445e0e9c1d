"""Newton's method on a few bounded parameters, for several independent problems side by side.

It knows nothing of images: `evaluate` returns the system of every problem at given parameters (model.py). Each step
goes to the lowest point of the quadratic model, as far as the bounds let it (`_step`). Where the cost is not convex,
the model is lifted until it is (`_convex`). Steps are damped, by Nielsen's rule (1999): the damping falls smoothly with
how well the model predicted the gain, and rises faster after every failure. After each step, parameters that enter
linearly go to their optimum for the others (`settled`; Ruhe & Wedin 1980).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.methods.sucre.model import ReducedSystem

_FIRST_DAMPING = 1e-3

# With so much damping no step of any length lowers the cost: it is at its rounding, or at a kink.
_STUCK = 1e12

# Added to a matrix of unit diagonal, so that parameters of which only a combination matters have a step.
_SINGULAR = 1e-12
# Added besides the lift of a matrix that is not convex.
_CONVEX = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """The ranges of n parameters, and which of them enter linearly."""

    # The range of each parameter, (n,).
    lower: Array
    upper: Array

    linear: Mask
    """Those that enter linearly, (n,) bool. Of two such no best value depends on the other's."""

    def held(self, at: Array, g: Array) -> Mask:
        """The parameters (C, n) at a bound that the cost pushes out."""
        return ((at <= self.lower) & (g < 0)) | ((at >= self.upper) & (g > 0))


@dataclass(frozen=True, slots=True, eq=False)
class Minimum:
    """The end of the steps, for C problems."""

    at: Array
    """The parameters, (C, n)."""

    system: ReducedSystem
    """That of one step before, as the last step gains too little to be evaluated."""

    free: Mask
    """Parameters not held at a bound, (C, n) bool."""

    steps: int
    """Evaluations after the first."""

    converged: Mask
    """Whether no step promises a relative gain above the tolerance, (C,) bool."""


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

    evaluate: parameters (C, n) -> ReducedSystem; floor: a cost that is only rounding; most: evaluations, which may
    become one more.
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
        best = np.clip(at + moved, bounds.lower, bounds.upper)
        gain = (2 * system.g * (best - at) - curve * (best - at) ** 2).sum(axis=1)
        matters = gain > tolerance * (system.cost + floor)
        if not (matters & (system.cost - gain < below)).any():
            return at, system
        of_best = evaluate(best)
        n_evaluations += 1
        is_lower = of_best.cost < system.cost
        return np.where(is_lower[:, None], best, at), of_best.where(is_lower, system)

    at, system = settled(np.clip(start, bounds.lower, bounds.upper), np.inf)
    damping, growth = np.full(len(at), _FIRST_DAMPING), np.full(len(at), 2.0)
    better = np.ones(len(at), dtype=bool)
    while True:
        if better.any():
            scale, lift = _convex(system, ~bounds.held(at, system.g), bounds.linear)
            # A short damped step is no convergence.
            last, most_gain = _step(at, system, bounds, scale, lift)
        promised_little = most_gain <= tolerance * (system.cost + floor)
        converged = promised_little | (damping >= _STUCK)
        if converged.all() or n_evaluations > most:
            break
        trial, promised = _step(at, system, bounds, scale, lift + damping)
        trial = np.where(converged[:, None], at, trial)
        trial, tried = settled(trial, np.where(converged, -np.inf, system.cost))
        gain = (system.cost - tried.cost) / np.maximum(promised, np.finfo(float).tiny)
        better = (gain > 0) & ~converged
        damping = np.where(
            better,
            damping * np.maximum(1 / 9, 1 - (2 * gain.clip(0, 1) - 1) ** 3),
            damping * growth,
        ).clip(max=_STUCK)
        growth = np.where(better, 2.0, 2 * growth)
        at = np.where(better[:, None], trial, at)
        system = tried.where(better, system)
    at = np.where(promised_little[:, None], last, at)
    free = ~bounds.held(at, system.g) & (np.einsum("cii->ci", system.H) > 0)
    return Minimum(at, system, free, n_evaluations - 1, converged)


def _convex(system: ReducedSystem, free: Mask, linear: Mask) -> tuple[Array, Array]:
    """Return the scale S (C, n) of each parameter, and how much damping (C,) makes the quadratic model convex.

    free: (C, n) bool, parameters that no bound holds. The scale of others is 0, and of those that nothing depends on.
    What counts is the curvature that is left where linear parameters follow the others: with a veil near 0, that of
    backscatter by itself is nearly none.
    """
    K = system.K
    own = np.einsum("cii->ci", system.H)
    known = free & (own > 0) & np.asarray(np.isfinite(K).all(axis=(1, 2)))[:, None]
    rest = K - (K / np.where(known & linear, own, np.inf)[:, None]) @ K
    size = np.where(
        linear, own.clip(min=0), np.maximum(own, np.abs(np.einsum("cii->ci", rest)))
    )
    scale = np.divide(1, np.sqrt(size), out=np.zeros_like(size), where=known)
    lowest = np.linalg.eigvalsh(_scaled(rest, np.where(linear, 0, scale)))[:, 0]
    return scale, np.where(lowest < 0, -1.1 * lowest + _CONVEX, 0)


def _scaled(K: Array, scale: Array) -> Array:
    """Return S K S (C, n, n), that of the unit matrix for parameters of scale 0."""
    return _among(scale > 0, K * scale[:, :, None] * scale[:, None, :])


def _among(free: Mask, A: Array) -> Array:
    """Return A (C, n, n), with the rows and columns of the unit matrix for parameters that are not free, (C, n)."""
    return np.where(free[:, :, None] & free[:, None, :], A, np.eye(A.shape[1]) * ~free[:, None])


def _step(
    at: Array, system: ReducedSystem, bounds: Bounds, scale: Array, damping: Array
) -> tuple[Array, Array]:
    """Return where (C, n) the way to the lowest point of the quadratic model, damped on the diagonal of S K S, leads.

    Also by how much (C,) the undamped model is lower there. A parameter that reaches its bound on the way stays on it
    for this step, and the others go on to their lowest point. So the model only falls. Parameters of scale 0 stay.
    """
    free = scale > 0
    A = _scaled(system.K, scale) + (_SINGULAR + damping)[:, None, None] * np.eye(at.shape[1])
    low, high = (
        np.divide(bound - at, scale, out=np.zeros_like(at), where=free)
        for bound in (bounds.lower, bounds.upper)
    )
    t = np.zeros_like(at)
    for _ in range(at.shape[1] + 1):
        held = np.where(free, 0, t)
        pull = np.where(free, scale * system.g - np.einsum("cij,cj->ci", A, held), t)
        best = np.linalg.solve(_among(free, A), pull[..., None])[..., 0]
        inside = np.clip(best, low, high)
        share = np.divide(
            inside - t, best - t, out=np.ones_like(t), where=free & (best != inside)
        )
        least = share.min(axis=1, keepdims=True)
        reached = free & (best != inside) & (share == least)
        t = np.where(reached, inside, t + least * (best - t))
        free &= ~reached
        if not reached.any():
            break
    to = np.where(t <= low, bounds.lower, np.where(t >= high, bounds.upper, at + scale * t))
    to = np.where(scale > 0, to, at)
    slope = 2 * np.einsum("ci,ci->c", system.g, to - at)
    return to, slope - np.einsum("ci,cij,cj->c", to - at, system.K, to - at)
