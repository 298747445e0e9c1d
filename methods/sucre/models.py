"""The models that can be fitted to a view or a dive, and the water that a fit of one finds.

| part of a model | choices |
|---|---|
| what is fitted | footprints that average the same ground in all views, single pixels, or nothing |
| colours | free, or held above zero, up to noise |
| weights | one for all, or less for observations that do not fit (robust.py) |
| coefficients | beta and gamma, or one for both (the paper's eq. 1) |
| light | even, a lens, a gain for each view, a gain for each view and channel (light.py) |

One choice is no fit to the minimum: the first 200 steps of the paper's Adam. They stop near their start, which acts as
a prior. judge.py chooses a model for a dive.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import NotApplicableError
from sucre_bench.machine.compute import Device
from sucre_bench.methods.sucre.exact import WaterFit, check_pairs, fit
from sucre_bench.methods.sucre.light import (
    EVEN_LIGHT,
    Light,
    LightFit,
    Parts,
    Sample,
    fit_light,
)
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.observed import SAMPLE, Observed, sampled
from sucre_bench.methods.sucre.passes import Backend, opened
from sucre_bench.methods.sucre.robust import (
    WRONG,
    contradicted_views,
    fit_robustly,
    reweighted,
    robust_noise,
    trust,
    trusted,
)
from sucre_bench.methods.sucre.solution import Course, LightRecord, Solution, coloured
from sucre_bench.methods.sucre.uncertainty import (
    WaterUncertainty,
    clustered,
    rescaled_to_noise,
    uncertainty_of,
)
from sucre_bench.multiview.observations import Observations

# Pixels that observations are judged on, whether they fit.
_JUDGED = 5_000

# Pixels that light is fitted to, and those that its start comes from.
_LIT = 4_000
_STARTED = 1_500

# From here on, a channel may have been cut off.
_FULL = 0.99

# Gains of this much are worth a word: of exposure, and of channels.
_DIFFERENT = {1: 0.05, 3: 0.01}

# A strobe, or a lens that is not corrected, leaves less light than this in the darkest place.
_DIM = 0.8

# Distances are alike if their percentile 95 is less than this many times their percentile 5.
_ALIKE = 1.5

# Less optical depth than this over the farthest distances is none. Pure water has as much in red over half a metre.
_AS_IN_AIR = 0.15


class Fit(Enum):
    """What the water is fitted to."""

    FOOTPRINTS = "footprints"
    PIXELS = "pixels"
    EARLY = "the paper's 200 steps"
    NOTHING = "no water"


@dataclass(frozen=True, slots=True)
class Model:
    """What is fitted: a choice for each part; the defaults are the simplest."""

    fit: Fit
    is_physical: bool = False
    is_robust: bool = False
    one_coefficient: bool = False
    light: Parts = EVEN_LIGHT

    @property
    def words(self) -> str:
        """The model in words, such as "footprints, colours above zero, exposure+lens"."""
        parts = {
            "colours above zero": self.is_physical,
            "robust": self.is_robust,
            "one coefficient": self.one_coefficient,
            "+".join(self.light.words): self.light != EVEN_LIGHT,
        }
        return ", ".join([self.fit.value, *(word for word, has in parts.items() if has)])


@dataclass(frozen=True, slots=True, eq=False)
class Fitted:
    """A water that was fitted to observations."""

    water: WaterParameters
    uncertainty: WaterUncertainty
    course: Course

    noise: Array | None = None
    """Of a pixel's observation, (3,), if robust weights count, which need it; else None."""

    light: Light | None = None
    """What was removed from the observations before."""

    def decided(self, **course: Any) -> Fitted:
        """Return it with more in its course."""
        return replace(self, course=replace(self.course, **course))

    def with_limits(self, limits: list[str]) -> Fitted:
        """Return it with more limits."""
        return replace(self, uncertainty=self.uncertainty.with_limits(limits))

    def colours_of(
        self, observations: Observations, *, backend: Backend = "auto", device: Device = "auto"
    ) -> Solution:
        """Return the colours of observations in this water, with weights for how well they fit if these count."""
        of_all = None
        uncertainty = self.uncertainty
        if self.noise is not None:
            of_all = trust(observations, self.water, self.noise)
            observations = trusted(observations, of_all)
        with opened(observations, backend, device) as kernel:
            if self.noise is None:
                # the water's errors come from a sample, the colours' from their own noise
                own = uncertainty_of(
                    self.water, kernel.system(self.water), None, observations.n_excess
                )
                noise = np.where(np.isfinite(own.noise), own.noise, uncertainty.noise)
                uncertainty = replace(uncertainty, noise=noise)
            solution = coloured(
                kernel, self.water, uncertainty, replace(self.course, device=kernel.device)
            )
        return replace(solution, trust=of_all, light=self.light)


def fit_model(
    model: Model, seen: Observed, light: LightFit | None = None, near: Fitted | None = None
) -> Fitted:
    """Fit the water of a model to a view or a dive.

    light: that was fitted before, None to fit it if the model has any; near: the fit of the model to more views.
    Where too few pixels have matched footprints, single pixels are fitted. Raises what `fit` raises.
    """
    if model.fit is Fit.EARLY:
        steps = stepped(model, seen)
        return Fitted(steps.water, steps.uncertainty, steps.course)
    matched = seen.matched if model.fit is Fit.FOOTPRINTS else None
    options: dict[str, Any] = seen.options.compute | {
        "physical": model.is_physical,
        "robust": model.is_robust,
        "near": near and near.water,
    }
    if model.light == EVEN_LIGHT:
        return fit_water(seen.observations, matched, **options)
    light = light or light_of(model, seen)
    even = seen.evened(light.light).observations
    if not even.n_repeated:
        raise NotApplicableError(
            "the light leaves no pixel that two views show",
            remedy="use method.light=even",
        )
    fitted = fit_water(
        even, None if matched is None else light.light.removed(matched), **options
    )
    return _with_light(fitted, light, seen, even)


def light_of(model: Model, seen: Observed, near: LightFit | None = None) -> LightFit:
    """Fit the light of a model together with a water, to footprints where there are enough; near: see `fit_model`."""
    few = seen.matched
    if few is None:
        few = sampled(seen.with_rays().observations, SAMPLE, singles=False, seed=0)
    few = uncut(few)
    if not few.n_repeated:
        raise NotApplicableError(
            "no pixel that two views show tells of the light",
            remedy="use method.light=even",
        )
    start = near.light.over(few.views) if near else None
    if start is None:
        water = fit(sampled(few, _STARTED, singles=False, seed=0), **seen.options.compute).water
        start = Light.even(water, few.views)
    if model.is_robust:  # animals tell nothing of the light
        few = reweighted(few, start.water, robust_noise(few, start.water))
    sample = Sample.of(sampled(few, _LIT, singles=False, seed=0), seen.view.name)
    return fit_light(sample, model.light, start)


def uncut(observations: Observations) -> Observations:
    """Return the pixels that no view shows with a channel at the end of the scale, where light is cut off."""
    kept = np.ones(len(observations.pixels), dtype=bool)
    for n, part in observations.slots():
        kept[:n] &= (observations.intensity(part) < _FULL).all(axis=0)
    return observations if kept.all() else observations.take(np.flatnonzero(kept))


def stepped(model: Model, seen: Observed) -> Solution:
    """Return what the paper's 200 steps of Adam find, its colours too: those of `sucre_paper`."""
    from sucre_bench.methods.sucre.paper import SucrePaper, solve_adam

    check_pairs(seen.observations)
    options = SucrePaper(one_coefficient=model.one_coefficient, device="cpu")
    return solve_adam(seen.observations, seen.first_colours(seen.observations), options)


def _with_light(fitted: Fitted, found: LightFit, seen: Observed, even: Observations) -> Fitted:
    """Return the water of observations in even light, with the errors that the light adds, and what to say of it."""
    light = found.light
    uncertainty = fitted.uncertainty
    before = uncertainty.standard_error.by_channel()
    error = np.fmax(before, found.error)
    alike = uncertainty.alike
    if alike is not None:  # errors of beta are most of what places and views share
        alike = (
            alike
            * np.divide(error, before, out=np.ones((3, 3)), where=before > 0)[:, 1, None, None]
            ** 2
        )
    uncertainty = replace(
        uncertainty, standard_error=WaterParameters.of_channels(error), alike=alike
    )
    said = list(sentences_of(light, seen.matched or even))
    by_view = zip(
        light.views,
        np.exp(light.gains[:, 0] if light.parts.gains == 1 else light.gains),
        strict=True,
    )
    gains = {name: gain.tolist() for name, gain in by_view if np.isfinite(gain).all()}
    if light.parts.gains and (unknown := [name for name in even.views if name not in gains]):
        said.append(
            f"views that share too few pixels to find their light took no part: {', '.join(unknown)}"
        )
    record = LightRecord(
        light.parts.words, light.least_on(seen.matched or even) if light.parts.lens else None
    )
    fitted = replace(fitted, uncertainty=uncertainty.with_limits(said), light=light)
    return fitted.decided(
        light=record, gains={seen.view.name: 1.0} | gains if light.parts.gains else None
    )


def sentences_of(light: Light, observations: Observations) -> Iterator[str]:
    """Say what was removed; observations: where light falls off, which says nothing of places without pixels."""
    if light.parts.gains:
        gains = np.exp(light.gains)
        low, high = np.nanmin(gains), np.nanmax(gains)
        what = "exposure" if light.parts.gains == 1 else "white balance"
        if high > (1 + _DIFFERENT[light.parts.gains]) * low:
            yield f"{what} differs between views; gains of {low:.2f} to {high:.2f} were fitted"
    if light.parts.lens and (least := light.least_on(observations)) < 1 - _DIFFERENT[3]:
        yield f"light falls off across the images, to {least:.0%} where pixels tell; the falloff was removed"
        if least < _DIM:
            yield "if a strobe lit this, colours over distance were not measured"


def fit_water(
    observations: Observations,
    matched: Observations | None = None,
    *,
    physical: bool = False,
    robust: bool = False,
    near: WaterParameters | None = None,
    backend: Backend = "auto",
    device: Device = "auto",
) -> Fitted:
    """Fit the water; with `robust`, to observations weighted by how well they fit. Raises what `fit` raises.

    matched: observations of some pixels that the water is fitted to instead (see multiview/footprints.py). Weak priors
    then count by errors that hold if the residuals of neighbours, or of a view, are alike. near: see `fit`.
    """
    how: Callable[..., WaterFit] = partial(fit, backend=backend, device=device)
    sharp = sampled(observations, SAMPLE, singles=physical, seed=0)
    to_fit = observations if matched is None else matched
    few = sharp if matched is None else matched
    said = list[str]()
    noise = None
    wrong = None
    start = how if near is None else partial(how, near=near)
    if robust:
        found, to_fit = fit_robustly(few, how, plain=None if near is None else start(few))
        judged = sampled(few, _JUDGED * few.stacked, singles=False, seed=0)
        v = trust(judged, found.water)
        said, wrong = contradicted_views(judged, v), float((v < WRONG).mean())
        noise = robust_noise(sharp, found.water)
        if matched is None:
            to_fit = trusted(observations, trust(observations, found.water, noise))
            found = start(to_fit)
    else:
        found = start(to_fit)
    if matched is not None:
        how = partial(how, growth=grown(found, to_fit))
        found = how(to_fit, near=found.water)
    if physical:
        near_or_free = {"free": found.water} if near is None else {"near": near}
        found = how(
            to_fit, physical=True, sharp=None if matched is None else sharp, **near_or_free
        )
    uncertainty = (
        found.uncertainty if noise is None else rescaled_to_noise(found.uncertainty, noise)
    )
    if matched is not None:
        uncertainty = clustered(uncertainty, to_fit, found.water)
    course = Course(
        solver="exact",
        device="cpu",
        steps=found.passes,
        converged=found.converged,
        footprint=matched is not None,
        unexplained=None if matched is None else float(robust_noise(few, found.water).mean()),
        robust=None if wrong is None else {"wrong": wrong},
        physical=physical,
    )
    return Fitted(found.water, uncertainty.with_limits(said), course, noise)


def grown(found: WaterFit, to_fit: Observations) -> Array:
    """Return how many times larger (3,) errors are than those of independent observations: rms over the parameters."""
    old = found.uncertainty.standard_error.by_channel()
    new = clustered(found.uncertainty, to_fit, found.water).standard_error.by_channel()
    known = np.isfinite(old) & (old > 0)
    squares = np.divide(new, old, out=np.zeros((3, 3)), where=known) ** 2
    return np.sqrt(squares.sum(axis=1) / known.sum(axis=1).clip(1)).clip(1)


def is_in_air(observations: Observations, fitted: Fitted) -> bool:
    """Decide whether nothing dims the images: no channel has a veil or is attenuated, and the distances tell it.

    A beta of 0, the end of the range, may have no error. Then distances must differ: all alike, they tell nothing.
    """
    uncertainty, water = fitted.uncertainty, fitted.water
    near, far = np.quantile(observations.distance, (0.05, 0.95))
    error = uncertainty.standard_error.beta * far
    told = error[np.isfinite(error)] < _AS_IN_AIR
    is_told = told.all() if len(told) else far > _ALIKE * near
    is_clear = not water.B.any() and (water.beta * far < _AS_IN_AIR).all()
    return bool(all(uncertainty.is_weak) and is_clear and is_told)
