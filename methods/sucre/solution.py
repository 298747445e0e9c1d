"""A view with its observations, `Observed`; the result of every solver, `Solution`; and colours in a water."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sucre_bench import Arrays
from sucre_bench.arrays import Array, Indices
from sucre_bench.camera import pixel_rays
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.machine.compute import Device
from sucre_bench.methods.sucre.diagnostics import WaterUncertainty, for_known_water, uncertainty_of
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.passes import Backend, Kernel, opened
from sucre_bench.multiview.observations import Observations
from sucre_bench.scene import Encoding, Scene, View

if TYPE_CHECKING:
    from sucre_bench.methods.sucre.light import Light
    from sucre_bench.methods.sucre.sucre import Sucre

# Pixels of the sample: a fit on 5,000 was within 1e-4 of the full cost; four times as many cost little. The fewest with
# equal footprints that are worth a fit of their own.
SAMPLE, _FEWEST_MATCHED = 20_000, 200


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LightRecord:
    """What the light was taken for: parts, the models that were judged, the least light in a corner, and a strobe."""

    parts: list[str]
    tried: list[dict[str, Any]]
    least: float | None
    strobe: dict[str, Array] | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Course:
    """How a solution was found, in the words of its record; None where nothing was to be decided.

    solver: exact; adam; given, the water is from elsewhere; none, the photograph without a water. steps: passes over
    all observations; initial_cost: (3,) of Adam's start. footprint: whether the water was fitted to equal footprints;
    unexplained: their mean noise in it, an intensity; robust: "wrong", the share of observations that weights leave
    out; physical: whether colours were held above zero. gains: of views by name, a number or three each; black:
    (3,), what was subtracted from the colours; residuals: their statistics.
    """

    solver: Literal["exact", "adam", "given", "none"]
    device: str
    steps: int | None = None
    converged: bool | None = None
    initial_cost: Array | None = None
    footprint: bool | None = None
    unexplained: float | None = None
    robust: Mapping[str, float] | None = None
    physical: bool | None = None
    light: LightRecord | None = None
    gains: Mapping[str, Any] | None = None
    black: Array | None = None
    residuals: Mapping[str, Any] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """A water and the colours in it.

    J, deviation: (3, P) float32, in the order of `Observations.pixels`, intensities without water and their standard
    deviation; cost: (3,) sum of squared residuals; uncertainty: of the water; trust: (N,) robust weight of each
    observation, 0 to 1; light: that was removed from the observations; growth: (3, P), how many times larger than
    `deviation` the standard deviation is if residuals of neighbours and of a view are alike.
    """

    J: Array
    deviation: Array
    water: WaterParameters
    cost: Array
    uncertainty: WaterUncertainty
    course: Course
    trust: Array | None = None
    light: Light | None = None
    growth: Array | None = None

    @property
    def is_photograph(self) -> bool:
        return self.course.solver == "none"

    @property
    def is_under_strobe(self) -> bool:
        return self.light is not None and self.light.strobe is not None

    def with_limits(self, limits: Iterable[str]) -> Solution:
        """Return the solution with more limits."""
        uncertainty = replace(self.uncertainty, limits=(*self.uncertainty.limits, *limits))
        return replace(self, uncertainty=uncertainty)

    def decided(self, **course: Any) -> Solution:
        """Return the solution with more in its course."""
        return replace(self, course=replace(self.course, **course))


@dataclass(frozen=True, eq=False)
class Observed:
    """A view of a scene as options see it: its image, and the observations of its pixels."""

    options: Sucre
    scene: Scene
    view: View
    observations: Observations

    @staticmethod
    def of(options: Sucre, scene: Scene, view: View) -> Observed:
        """Raises NotApplicableError when no pixel has depth or none is seen twice."""
        return Observed(options, scene, view, options.observe(scene, view))

    @cached_property
    def matched(self) -> Observations | None:
        """A sample with equal footprints (multiview/footprints.py), None where too few pixels have one."""
        n = self.observations.n_repeated
        if n < _FEWEST_MATCHED:
            return None
        chosen = np.random.default_rng(0).choice(n, min(n, SAMPLE), replace=False)
        found = self.matched_at(self.observations.pixels[chosen])
        return found if found.n_repeated >= _FEWEST_MATCHED else None

    def matched_at(self, pixels: Indices, wider: float = 1.0) -> Observations:
        """Return observations of pixels (flat indices) with equal footprints, so many times wider than they need be."""
        from sucre_bench.multiview.footprints import matched_footprints

        shown = set(self.observations.views)
        views = [other for other in self.scene.views if other.name in shown]
        how = self.options.pairing_with(with_view=True, with_ray=True)
        return matched_footprints(self.view, views, pixels, **how, wider=wider)

    def alone(self) -> Observed:
        """Return the view with its own observations alone."""
        from sucre_bench.multiview.observe import observe

        return replace(self, observations=observe(self.view, [self.view], **self.options.pairing_with()))

    @property
    def encoding(self) -> Encoding:
        """The encoding of the intensities that are fitted."""
        return "linear" if self.options.encoding == "linear" else self.view.encoding

    @property
    def is_decoded(self) -> bool:
        return self.encoding != self.view.encoding

    @property
    def intensities(self) -> Array:
        """The view's intensities (H, W, 3) in the encoding that is fitted."""
        return srgb_decode(self.view.rgb) if self.is_decoded else self.view.rgb

    def evened(self, light: Light) -> Observed:
        """Return the view and its observations as even light would show them.

        Intensities may exceed 1. A strobe's light needs depth; the view is NaN elsewhere.
        """
        assert self.view.camera is not None
        rays = np.moveaxis(pixel_rays(self.view.camera), -1, 0)[:2]
        unknown = np.nan if light.parts.strobe else 1.0
        z = np.where(self.view.depth > 0, self.view.distance, unknown).astype(np.float64)
        recorded = np.moveaxis(self.intensities, -1, 0)
        even = np.moveaxis(replace(light, gains=np.zeros((1, 3))).evened(recorded, rays, z, 0)[0], 0, -1)
        rgb = (srgb_encode(even) if self.is_decoded else even).astype(np.float32)
        view = replace(self.view, pixels=Arrays(rgb, self.view.depth, self.view.reference))
        observations = self.options.observe(self.scene, self.view, with_view=True, with_ray=True)
        return replace(self, view=view, observations=light.removed(observations))

    def coloured(self, water: WaterParameters, uncertainty: WaterUncertainty | None = None) -> Solution:
        """Return the colours in a water: see `colours_for_water`."""
        options = self.options
        return colours_for_water(self.observations, water, uncertainty, options.backend, options.device)


def colours_for_water(
    observations: Observations,
    water: WaterParameters,
    uncertainty: WaterUncertainty | None,
    backend: Backend | Literal["numpy"],
    device: Device,
) -> Solution:
    """Return the colours in a water that is known, from elsewhere (uncertainty None) or from a common fit."""
    with opened(observations, backend, device) as kernel:
        known = uncertainty or for_known_water(uncertainty_of(water, kernel.system(water), None, observations.n_excess))
        return coloured(kernel, water, known, Course(solver="given", device=kernel.device))


def coloured(kernel: Kernel, water: WaterParameters, uncertainty: WaterUncertainty, course: Course) -> Solution:
    """Return the colours of a kernel's observations."""
    J, deviation = kernel.colours(water, uncertainty.noise, uncertainty.covariance)
    growth = None
    if uncertainty.alike is not None:
        _, wide = kernel.colours(water, uncertainty.noise, uncertainty.alike)
        growth = np.divide(wide, deviation, out=np.ones_like(wide), where=deviation > 0).clip(min=1)
    return Solution(J, deviation, water, kernel.system(water).cost, uncertainty, course, growth=growth)


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
