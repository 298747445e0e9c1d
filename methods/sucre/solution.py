"""The result of every solver, `Solution`, and how it was found, `Course`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.machine.compute import Device
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.passes import Backend, Kernel, opened
from sucre_bench.methods.sucre.uncertainty import (
    WaterUncertainty,
    for_known_water,
    uncertainty_of,
)
from sucre_bench.multiview.observations import Observations

if TYPE_CHECKING:
    from sucre_bench.methods.sucre.light import Light


@dataclass(frozen=True, slots=True)
class LightRecord:
    """What the light was taken for: its parts, and the least light of a lens where pixels tell it."""

    parts: Sequence[str] = ()
    least: float | None = None


# The judge admits a model, and a picture counts as measured, with at most this share of a channel below zero.
MOST_NEGATIVE = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """A model that was fitted to half of a dive's views and judged on the others; see judge.py.

    held_out: its error in views that it has not seen, over that of no water; negative: (3,) share of colours below
    zero; drift: of colours from near to far ground, in a* b*, and that of the photograph.
    """

    model: str
    held_out: float
    negative: Sequence[float]
    drift: float
    drift_of_photograph: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Course:
    """How a solution was found, in the words of its record; None where nothing was to be decided.

    solver: exact; adam; given, the water is from elsewhere; none, the photograph without a water. steps: passes over
    all observations; initial_cost: (3,) of Adam's start. footprint: whether the water was fitted to equal footprints;
    unexplained: their mean noise in it, an intensity; robust: "wrong", the share of observations that weights leave
    out; physical: whether colours were held above zero. model: what was fitted; judged: the models it was chosen from,
    the chosen one first. gains: of views by name, a number or three each; residuals: their
    statistics.
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
    model: str | None = None
    judged: Sequence[Judged] | None = None
    light: LightRecord | None = None
    gains: Mapping[str, Any] | None = None
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

    def with_limits(self, limits: Iterable[str]) -> Solution:
        """Return the solution with more limits."""
        return replace(self, uncertainty=self.uncertainty.with_limits(limits))

    def decided(self, **course: Any) -> Solution:
        """Return the solution with more in its course."""
        return replace(self, course=replace(self.course, **course))


def colours_for_water(
    observations: Observations,
    water: WaterParameters,
    uncertainty: WaterUncertainty | None,
    backend: Backend | Literal["numpy"],
    device: Device,
) -> Solution:
    """Return the colours in a water that is known, from elsewhere (uncertainty None) or from a common fit."""
    with opened(observations, backend, device) as kernel:
        known = uncertainty or for_known_water(
            uncertainty_of(water, kernel.system(water), None, observations.n_excess)
        )
        return coloured(kernel, water, known, Course(solver="given", device=kernel.device))


def coloured(
    kernel: Kernel, water: WaterParameters, uncertainty: WaterUncertainty, course: Course
) -> Solution:
    """Return the colours of a kernel's observations."""
    J, deviation = kernel.colours(water, uncertainty.noise, uncertainty.covariance)
    growth = None
    if uncertainty.alike is not None:
        _, wide = kernel.colours(water, uncertainty.noise, uncertainty.alike)
        growth = np.divide(wide, deviation, out=np.ones_like(wide), where=deviation > 0).clip(
            min=1
        )
    return Solution(
        J, deviation, water, kernel.system(water).cost, uncertainty, course, growth=growth
    )
