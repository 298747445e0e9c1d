"""The ways to find water and colours, with one kind of result, `Solution`.

adam: the paper's, on all unknowns at once. adam_closed_form: Adam on the nine parameters of the water alone, with each
pixel's best colour at every step; the gradient of the reduced cost is that of the full one there, since the colours are
at their optimum. exact: see exact.py. colours_for_water: the water is known, the colours follow in closed form.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import SolveError
from sucre_bench.machine.compute import Device
from sucre_bench.machine.progress import track
from sucre_bench.methods.sucre.diagnostics import WaterUncertainty, for_known_water, rescaled_to_noise, uncertainty_of
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.passes import Backend, Kernel, backend_for, opened
from sucre_bench.methods.sucre.uneven_light import TargetLight
from sucre_bench.multiview.observations import Observations

# The paper's start: J = I and B = beta = gamma = 0.1.
_INITIAL_WATER = WaterParameters.of_channels(np.full((3, 3), 0.1))

# Adam's own default (Kingma & Ba 2015), which the paper does not change.
_EPS = 1e-8


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """A water and the colours in it.

    J, deviation: (3, P) float32, in the order of `Observations.pixels`, intensities without water and their standard
    deviation; cost: (3,) sum of squared residuals; uncertainty: of the water; about: solver, steps, and the like;
    weight: (N,) of each observation, from robust=true; is_photograph: J is the photograph, without a water; light: on
    the target, where uneven light was removed from the observations.
    """

    J: Array
    deviation: Array
    water: WaterParameters
    cost: Array
    uncertainty: WaterUncertainty
    about: dict[str, Any] = field(default_factory=dict)
    weight: Array | None = None
    is_photograph: bool = False
    light: TargetLight | None = None

    def with_limits(self, limits: Iterable[str]) -> Solution:
        """Return the solution with more limits."""
        uncertainty = replace(self.uncertainty, limits=(*self.uncertainty.limits, *limits))
        return replace(self, uncertainty=uncertainty)


def start_of(observations: Observations, intensities: Array) -> Array:
    """Return the paper's start J = I (3, P): the target's intensities (H W, 3), or another view's where not finite."""
    target_intensities = intensities[observations.pixels].swapaxes(0, 1)
    return np.where(
        np.isfinite(target_intensities), target_intensities, observations.intensity(slice(0, len(observations.pixels)))
    )


def solve_adam(
    observations: Observations,
    start: Array,
    steps: int,
    lr: float,
    objective: Literal["sum", "mean"],
    backend: Backend,
    device: Device,
) -> Solution:
    """Take the paper's steps from J = start (3, P), the target's intensities. SolveError when they diverge."""
    from sucre_bench.methods.sucre.adam import minimise

    eps = _EPS if objective == "sum" else _EPS * 3 * len(observations)  # the same as dividing the sum
    _, place = backend_for("torch", device)
    fit = minimise(observations, start, _INITIAL_WATER, steps=steps, lr=lr, eps=eps, device=place)
    _check_finite(fit.cost, steps, lr)
    with opened(observations, backend, device) as kernel:
        uncertainty = _uncertainty(kernel, observations, fit.water)
        _, deviation = kernel.colours(fit.water, uncertainty.noise, uncertainty.covariance)
    about = {"solver": "adam", "steps": steps, "initial_cost": fit.initial_cost.tolist(), "device": place}
    return Solution(fit.J, deviation, fit.water, fit.cost, uncertainty, about)


def solve_adam_closed_form(
    observations: Observations, steps: int, lr: float, backend: Backend, device: Device
) -> Solution:
    """Take Adam's steps on the water, with the best colours at each. SolveError when they diverge."""
    import torch

    from sucre_bench.methods.sucre.adam import Adam

    rows = torch.tensor(_INITIAL_WATER.by_channel())
    adam = Adam([rows], lr=lr, eps=_EPS)
    with opened(observations, backend, device) as kernel:
        for _ in track(range(steps), "SUCRe (Adam, closed form)"):
            adam.step([torch.from_numpy(-2 * kernel.system(WaterParameters.of_channels(rows.numpy())).g)])
        _check_finite(rows.numpy(), steps, lr)
        water = WaterParameters.of_channels(rows.numpy())
        uncertainty = _uncertainty(kernel, observations, water)
        return _with_colours(kernel, water, uncertainty, {"solver": "adam_closed_form", "steps": steps})


def solve_exact(
    observations: Observations,
    *,
    matched: Observations | None = None,
    physical: bool = False,
    robust: bool = False,
    backend: Backend = "auto",
    device: Device = "auto",
    seed: int = 0,
) -> Solution:
    """Find the minimum; with `robust`, of observations weighted by how well they fit. Raises what `fit` raises.

    matched: observations of some pixels that the water is fitted to instead (see multiview/footprints.py); all colours
    are those of `observations`.
    """
    from sucre_bench.methods.sucre.exact import fit
    from sucre_bench.methods.sucre.robust import fit_robustly, reweighted, robust_noise
    from sucre_bench.methods.sucre.samples import SAMPLE, sampled

    sharp = sampled(observations, SAMPLE, singles=physical, seed=seed) if robust or matched is not None else None
    held = [sharp] if physical and matched is not None and sharp is not None else []
    fitted = partial(fit, physical=physical, sharp=held, backend=backend, device=device, seed=seed)
    to_fit = observations if matched is None else matched
    noise: Array | None = None
    if robust and sharp is not None:  # water and weights are iterated on a sample; then all observations are weighted
        few = sharp if matched is None else matched
        water, weighted = fit_robustly(few, fitted)
        noise = robust_noise(sharp, water.water)
        observations = reweighted(observations, water.water, noise)
        to_fit = observations if matched is None else weighted
    found = fitted(to_fit)
    about = {"solver": "exact", "steps": found.passes, "converged": found.converged}
    with opened(observations, backend, device) as kernel:
        uncertainty = found.uncertainty
        if noise is not None and sharp is not None:
            uncertainty = rescaled_to_noise(uncertainty, robust_noise(sharp, found.water))
        elif matched is not None:  # the water's errors come from the sample, the colours' from their own noise
            uncertainty = replace(uncertainty, noise=_uncertainty(kernel, observations, found.water).noise)
        solution = _with_colours(kernel, found.water, uncertainty, about)
    return solution if noise is None else replace(solution, weight=observations.weight)


def colours_for_water(
    observations: Observations,
    water: WaterParameters,
    uncertainty: WaterUncertainty | None,
    backend: Backend,
    device: Device,
) -> Solution:
    """Return the colours in a water that is known, from elsewhere (uncertainty None) or from a common fit."""
    with opened(observations, backend, device) as kernel:
        known = uncertainty or for_known_water(_uncertainty(kernel, observations, water))
        return _with_colours(kernel, water, known, {"solver": "given"})


def _with_colours(
    kernel: Kernel, water: WaterParameters, uncertainty: WaterUncertainty, about: dict[str, Any]
) -> Solution:
    J, deviation = kernel.colours(water, uncertainty.noise, uncertainty.covariance)
    cost = kernel.system(water).cost
    return Solution(J, deviation, water, cost, uncertainty, {**about, "device": kernel.device})


def _uncertainty(kernel: Kernel, observations: Observations, water: WaterParameters) -> WaterUncertainty:
    """Return the uncertainty of a water that need not be the minimum."""
    return uncertainty_of(water, kernel.system(water), np.ones((3, 3), dtype=bool), observations.n_excess)


def _check_finite(values: Array, steps: int, lr: float) -> None:
    if not np.isfinite(values).all():
        raise SolveError(f"Adam diverged after {steps} steps; lower lr ({lr}) or steps")
