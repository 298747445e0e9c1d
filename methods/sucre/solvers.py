"""The ways to find water and colours, with one kind of answer.

adam: the paper's, on all unknowns at once. adam_closed_form: Adam on the nine parameters of the water alone, each
pixel's colour being the best one at every step; the gradient of the reduced cost is that of the full one there, since
the colours are at their optimum. exact: see exact.py.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import SolveError
from sucre_bench.machine.cores import Device
from sucre_bench.machine.progress import track
from sucre_bench.methods.sucre.diagnostics import Trust, judge, of_given, with_noise
from sucre_bench.methods.sucre.kernels import Backend, Kernel, backend_for, opened
from sucre_bench.multiview.observations import Observations

__all__ = ["Solution", "colours_in", "solve_adam", "solve_adam_closed_form", "solve_exact", "start_of"]

# The paper's start: J = I and B = beta = gamma = 0.1.
_INITIAL_WATER = np.full((3, 3), 0.1)

# Adam's own default (Kingma & Ba 2015), which the paper does not change.
_EPS = 1e-8


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """A water and the colours in it.

    J, deviation: (3, P) float32, in the order of the store's pixels, intensities without water and their standard
    deviation; water: (3, 3) float64, rows B, beta, gamma, columns RGB; cost: (3,) sum of squared residuals;
    trust: what is known about the water; about: solver, steps, and the like.
    """

    J: Array
    deviation: Array
    water: Array
    cost: Array
    trust: Trust
    about: dict[str, Any] = field(default_factory=dict)


def start_of(observations: Observations, intensities: Array) -> Array:
    """Return the paper's start J = I (3, P): the target's intensities (H W, 3), or another view's where not finite."""
    own = intensities[observations.pixels].T
    return np.where(np.isfinite(own), own, observations.intensity(slice(0, len(observations.pixels))))


def solve_adam(
    observations: Observations,
    own: Array,
    steps: int,
    lr: float,
    objective: Literal["sum", "mean"],
    backend: Backend,
    device: Device,
) -> Solution:
    """Take the paper's steps from J = own (3, P), the target's intensities. SolveError when they diverge."""
    from sucre_bench.methods.sucre.adam import minimise

    eps = _EPS if objective == "sum" else _EPS * 3 * len(observations)  # the same as dividing the sum
    _, place = backend_for("torch", device)
    fit = minimise(observations, own, _INITIAL_WATER, steps=steps, lr=lr, eps=eps, device=place)
    _check_finite(fit.cost, steps, lr)
    with opened(observations, backend, device) as kernel:
        trust = _judged(kernel, observations, fit.water)
        _, deviation = kernel.colours(fit.water.T, trust.noise, trust.covariance)
    about = {"solver": "adam", "steps": steps, "initial_cost": fit.initial_cost.tolist(), "device": place}
    return Solution(fit.J, deviation, fit.water, fit.cost, trust, about)


def solve_adam_closed_form(
    observations: Observations, steps: int, lr: float, backend: Backend, device: Device
) -> Solution:
    """Take Adam's steps on the water, colours in closed form at each. SolveError when they diverge."""
    import torch

    water = torch.tensor(_INITIAL_WATER.T.copy())  # rows channels
    adam = torch.optim.Adam([water], lr=lr, eps=_EPS)
    with opened(observations, backend, device) as kernel:
        for _ in track(range(steps), "SUCRe (Adam, closed form)"):
            water.grad = torch.from_numpy(-2 * kernel.system(water.numpy()).g)
            adam.step()
        found = water.numpy().T.copy()
        _check_finite(found, steps, lr)
        trust = _judged(kernel, observations, found)
        return _in_water(kernel, found, trust, {"solver": "adam_closed_form", "steps": steps})


def solve_exact(
    observations: Observations,
    *,
    physical: bool = False,
    robust: bool = False,
    backend: Backend = "auto",
    device: Device = "auto",
    seed: int = 0,
) -> Solution:
    """Find the minimum; with `robust`, of observations weighted by how they fit. Raises what `exact.fit` raises."""
    from sucre_bench.methods.sucre.exact import SAMPLE, fit, sampled
    from sucre_bench.methods.sucre.robust import fit_robustly, reweighted, robust_noise

    fitted = partial(fit, physical=physical, backend=backend, device=device, seed=seed)
    if robust:  # water and weights find one another on a sample; then all observations are weighted once
        few = sampled(observations, SAMPLE, physical, seed)
        water = fit_robustly(few, fitted)[0].water.T
        observations = reweighted(observations, water, robust_noise(few, water))
        found = fitted(observations)
        trust = with_noise(found.trust, robust_noise(few, found.water.T))
    else:
        found = fitted(observations)
        trust = found.trust
    about = {"solver": "exact", "steps": found.passes, "converged": found.converged}
    with opened(observations, backend, device) as kernel:
        return _in_water(kernel, found.water, trust, about)


def colours_in(
    observations: Observations, water: Array, trust: Trust | None, backend: Backend, device: Device
) -> Solution:
    """Return the colours in a water (3, 3: B, beta, gamma) that is known, from elsewhere or from a common fit."""
    with opened(observations, backend, device) as kernel:
        known = trust or of_given(_judged(kernel, observations, water))
        return _in_water(kernel, water, known, {"solver": "given"})


def _in_water(kernel: Kernel, water: Array, trust: Trust, about: dict[str, Any]) -> Solution:
    J, deviation = kernel.colours(water.T, trust.noise, trust.covariance)
    return Solution(J, deviation, water, kernel.system(water.T).cost, trust, {**about, "device": kernel.device})


def _judged(kernel: Kernel, observations: Observations, water: Array) -> Trust:
    """What the observations say of a water that need not be their best."""
    return judge(kernel.system(water.T), water.T, np.ones((3, 3), dtype=bool), observations.n_excess)


def _check_finite(values: Array, steps: int, lr: float) -> None:
    if not np.isfinite(values).all():
        raise SolveError(f"Adam diverged after {steps} steps; lower lr ({lr}) or steps")
