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
    """A model that was fitted to half of a dive's views and judged on the others; see judge.py."""

    model: str

    held_out: float
    """Its error in views that it has not seen, over that of no water."""

    negative: Sequence[float]
    """Share of colours below zero, (3,)."""

    # Of colours from near to far ground, in a* b*.
    drift: float
    drift_of_photograph: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Course:
    """How a solution was found, in the words of its record; None where nothing was to be decided."""

    solver: Literal["exact", "adam", "given", "none"]
    """With "given" the water is from elsewhere; "none" is the photograph without a water."""

    device: str

    steps: int | None = None
    """Passes over all observations."""

    converged: bool | None = None

    initial_cost: Array | None = None
    """Of Adam's start, (3,)."""

    footprint: bool | None = None
    """Whether the water was fitted to equal footprints."""

    unexplained: float | None = None
    """Mean noise of the footprints in this water, an intensity."""

    robust: Mapping[str, float] | None = None
    """Under "wrong", the share of observations that weights leave out."""

    physical: bool | None = None
    """Whether colours were held above zero."""

    model: str | None = None
    """What was fitted."""

    judged: Sequence[Judged] | None = None
    """The models it was chosen from, the chosen one first."""

    light: LightRecord | None = None

    gains: Mapping[str, Any] | None = None
    """Of views by name, a number or three each."""

    residuals: Mapping[str, Any] | None = None
    """Their statistics, see record.py."""


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """A water and the colours in it."""

    J: Array
    """Intensities without water, (3, P) float32, in the order of `Observations.pixels`."""

    deviation: Array
    """Standard deviation of J, (3, P) float32, in the same order."""

    water: WaterParameters

    cost: Array
    """Sum of squared residuals, (3,)."""

    uncertainty: WaterUncertainty
    course: Course

    trust: Array | None = None
    """Robust weight of each observation, (N,), 0 to 1."""

    light: Light | None = None
    """What was removed from the observations."""

    growth: Array | None = None
    """How many times larger than `deviation` the standard deviation is, (3, P), if residuals of neighbours and of a
    view are alike."""

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
