"""The result of every solver, `Solution`; the pixels that the water is fitted to; and colours in a water."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sucre_bench.arrays import Array, Indices
from sucre_bench.machine.compute import Device
from sucre_bench.methods.sucre.diagnostics import (
    WaterUncertainty,
    clustered,
    for_known_water,
    rescaled_to_noise,
    uncertainty_of,
)
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.passes import Backend, Kernel, opened
from sucre_bench.multiview.observations import Observations
from sucre_bench.scene import Scene, View

if TYPE_CHECKING:
    from sucre_bench.methods.sucre.light import Light
    from sucre_bench.methods.sucre.sucre import Sucre

# Pixels of the sample: a fit on 5,000 was within 1e-4 of the full cost; four times as many cost little.
SAMPLE = 20_000

# Pixels that the water is fitted to with matched footprints, and the fewest that are worth a fit of their own.
_MATCHED, _FEWEST_MATCHED = 20_000, 200

# A fit with colours above zero may leave residuals whose cost is larger by this share: .01 to .02 on photographs whose
# free fit takes shade for a veil. Noise of JPEG files makes dark colours negative with any veil; pushing them up raised
# the cost by .2 to 2.5.
_RISE = 0.05

# Pixels that observations are judged on, whether they fit.
_JUDGED = 5_000

# Fewer wrong observations than this share change no water.
_FEW_WRONG = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """A water and the colours in it.

    J, deviation: (3, P) float32, in the order of `Observations.pixels`, intensities without water and their standard
    deviation; cost: (3,) sum of squared residuals; uncertainty: of the water; about: solver, steps, and the like;
    weight: of each observation, as in `Observations`, from robust=true; is_photograph: J is the photograph, without a
    water; light: that was removed from the observations; growth: (3, P), how many times larger than `deviation` the
    standard deviation is if residuals of neighbours and of a view are alike.
    """

    J: Array
    deviation: Array
    water: WaterParameters
    cost: Array
    uncertainty: WaterUncertainty
    about: dict[str, Any] = field(default_factory=dict)
    weight: Array | None = None
    is_photograph: bool = False
    light: Light | None = None
    growth: Array | None = None

    @property
    def is_under_strobe(self) -> bool:
        return self.light is not None and self.light.strobe is not None

    def with_limits(self, limits: Iterable[str]) -> Solution:
        """Return the solution with more limits."""
        uncertainty = replace(self.uncertainty, limits=(*self.uncertainty.limits, *limits))
        return replace(self, uncertainty=uncertainty)


def solve_exact(
    observations: Observations,
    *,
    matched: Observations | None = None,
    physical: bool = False,
    one_coefficient: bool = False,
    robust: bool | Literal["auto"] = False,
    backend: Backend = "auto",
    device: Device = "auto",
) -> Solution:
    """Find the minimum; with `robust`, of observations weighted by how well they fit. Raises what `fit` raises.

    robust: auto weights them if robust.py's `is_better` says so.
    matched: observations of some pixels that the water is fitted to instead (see multiview/footprints.py); all colours
    are those of `observations`.
    """
    from sucre_bench.methods.sucre.exact import fit
    from sucre_bench.methods.sucre.robust import (
        WRONG,
        contradicted_views,
        fit_robustly,
        is_better,
        reweighted,
        robust_noise,
        trust,
    )

    sharp = sampled(observations, SAMPLE, singles=physical, seed=0) if robust or matched is not None else None
    fitted = partial(fit, one_coefficient=one_coefficient, backend=backend, device=device)
    to_fit = observations if matched is None else matched
    found = fitted(to_fit)
    about: dict[str, Any] = {}
    noise: Array | None = None
    contradicted: list[str] = []
    few = sharp if matched is None else matched
    judged = sampled(few, _JUDGED, singles=False, seed=0) if robust and few is not None else None
    is_tried = robust is True or (judged is not None and (trust(judged, found.water) < WRONG).mean() > _FEW_WRONG)
    if is_tried and judged and few and sharp:  # water and weights are iterated on a sample
        again, weighted = fit_robustly(few, fitted, plain=None if matched is None else found)
        v = trust(judged, again.water)
        contradicted = contradicted_views(judged, v)
        if robust is True or is_better(judged, found.water, again.water, v):
            noise = robust_noise(sharp, again.water)
            observations = reweighted(observations, again.water, noise)
            to_fit = observations if matched is None else weighted
            found = fitted(to_fit) if matched is None else again
            about["robust"] = {"wrong": float((v < WRONG).mean())}
    if physical:
        held = [sharp] if matched is not None and sharp is not None else []
        above = fitted(to_fit, physical=True, sharp=held)
        about["physical"] = matched is None or bool((above.cost <= (1 + _RISE) * found.cost).all())
        found = above if about["physical"] else found
    about |= {"solver": "exact", "steps": found.passes, "converged": found.converged}
    with opened(observations, backend, device) as kernel:
        uncertainty = found.uncertainty
        if noise is not None and sharp is not None:
            uncertainty = rescaled_to_noise(uncertainty, robust_noise(sharp, found.water))
        elif matched is not None:  # the water's errors come from the sample, the colours' from their own noise
            uncertainty = replace(uncertainty, noise=uncertainty_at(kernel, observations, found.water).noise)
        if matched is not None:
            uncertainty = clustered(uncertainty, [to_fit], found.water, tied=one_coefficient)
        solution = _with_colours(kernel, found.water, uncertainty, about).with_limits(contradicted)
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
    growth = None
    if uncertainty.alike is not None:
        _, wide = kernel.colours(water, uncertainty.noise, uncertainty.alike)
        growth = np.divide(wide, deviation, out=np.ones_like(wide), where=deviation > 0).clip(min=1)
    about = {**about, "device": kernel.device}
    return Solution(J, deviation, water, kernel.system(water).cost, uncertainty, about, growth=growth)


def uncertainty_at(
    kernel: Kernel, observations: Observations, water: WaterParameters, *, tied: bool = False
) -> WaterUncertainty:
    """Return the uncertainty of a water that need not be the minimum."""
    free = np.ones((3, 3), dtype=bool)
    return uncertainty_of(water, kernel.system(water), free, observations.n_excess, tied=tied)


def sampled(observations: Observations, n: int, *, singles: bool, seed: int) -> Observations:
    """Return n random pixels of those seen more than once, and with `singles` as large a share of the others."""
    rng = np.random.default_rng(seed)
    repeated, all_pixels = observations.n_repeated, len(observations.pixels)
    if n >= repeated:
        return observations.take(np.arange(all_pixels if singles else repeated))
    chosen = [rng.choice(repeated, n, replace=False)]
    if singles:
        share = round((all_pixels - repeated) * n / repeated)
        chosen.append(repeated + rng.choice(all_pixels - repeated, share, replace=False))
    return observations.take(np.sort(np.concatenate(chosen)))


def first_slot(observations: Observations) -> Observations:
    """Return each pixel with its first observation alone, which any water explains: it can only hold a colour up.

    The first that has a weight in all channels: those of a view whose light is not known have none.
    """
    n = len(observations.pixels)
    first = np.arange(n)
    if observations.weight is not None:
        for _, part in reversed(list(observations.slots())):
            known = np.flatnonzero(np.atleast_2d(observations.weight[..., part] > 0).all(axis=0))
            first[known] = part.start + known
    return replace(
        observations,
        counts=np.ones(n, dtype=np.int32),
        starts=np.array([0, n]),
        distance=observations.distance[first],
        colour=observations.colour[:, first],
        weight=None if observations.weight is None else observations.weight[..., first],
        view=None,
        ray=None,
    )


def matched_sample(options: Sucre, scene: Scene, view: View, observations: Observations) -> Observations | None:
    """Return a sample with matched footprints (multiview/footprints.py), None where too few pixels have one."""
    n = observations.n_repeated
    if n < _FEWEST_MATCHED:
        return None
    pixels = observations.pixels[np.random.default_rng(0).choice(n, min(n, _MATCHED), replace=False)]
    found = matched_at(options, scene, view, observations, pixels)
    return found if found.n_repeated >= _FEWEST_MATCHED else None


def matched_at(
    options: Sucre, scene: Scene, view: View, observations: Observations, pixels: Indices, wider: float = 1.0
) -> Observations:
    """Return observations of pixels (flat indices) with matched footprints; observations: name the views."""
    from sucre_bench.multiview.footprints import matched_footprints

    shown = set(observations.views)
    views = [other for other in scene.views if other.name in shown]
    how = options.pairing_with(with_view=True, with_ray=True)
    return matched_footprints(view, views, pixels, **how, wider=wider)
