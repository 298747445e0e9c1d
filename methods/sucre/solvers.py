"""The result of every solver, `Solution`, the exact one, and the colours in a water that is known."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.machine.compute import Device
from sucre_bench.methods.sucre.diagnostics import WaterUncertainty, for_known_water, rescaled_to_noise, uncertainty_of
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.passes import Backend, Kernel, opened
from sucre_bench.methods.sucre.uneven_light import TargetLight
from sucre_bench.multiview.observations import Observations


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
            uncertainty = replace(uncertainty, noise=uncertainty_at(kernel, observations, found.water).noise)
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
        known = uncertainty or for_known_water(uncertainty_at(kernel, observations, water))
        return _with_colours(kernel, water, known, {"solver": "given"})


def _with_colours(
    kernel: Kernel, water: WaterParameters, uncertainty: WaterUncertainty, about: dict[str, Any]
) -> Solution:
    J, deviation = kernel.colours(water, uncertainty.noise, uncertainty.covariance)
    cost = kernel.system(water).cost
    return Solution(J, deviation, water, cost, uncertainty, {**about, "device": kernel.device})


def uncertainty_at(kernel: Kernel, observations: Observations, water: WaterParameters) -> WaterUncertainty:
    """Return the uncertainty of a water that need not be the minimum."""
    return uncertainty_of(water, kernel.system(water), np.ones((3, 3), dtype=bool), observations.n_excess)
