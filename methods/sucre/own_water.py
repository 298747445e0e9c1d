"""Finds the water of one image from its own observations, exactly, with the options that go with that.

Each step may change the observations: a lamp or gains of views bring them to even light, and the solution explains
those. The steps hand both on together.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sucre_bench.errors import SolveError
from sucre_bench.machine.progress import say
from sucre_bench.methods.sucre.apply_gains import AtOneExposure, corrected
from sucre_bench.methods.sucre.diagnostics import is_determined
from sucre_bench.methods.sucre.exact import fit
from sucre_bench.methods.sucre.exposure import Exposure, differing_exposure
from sucre_bench.methods.sucre.exposure import estimate as estimate_gains
from sucre_bench.methods.sucre.falloff import Falloff, find_falloff, uncut, without_falloff
from sucre_bench.methods.sucre.footprint_sample import matched_sample
from sucre_bench.methods.sucre.lamp import estimate as estimate_lamp
from sucre_bench.methods.sucre.lamp import lit
from sucre_bench.methods.sucre.robust import robust_noise
from sucre_bench.methods.sucre.solvers import Solution, colours_for_water, solve_exact
from sucre_bench.methods.sucre.undetermined_water import (
    gains_explain_better,
    gains_may_explain,
    is_guess,
    photograph_as_colours,
)
from sucre_bench.methods.sucre.uneven_light import Removal, UnevenLight, explains_better, record_of, sentence_of
from sucre_bench.multiview.observations import Observations
from sucre_bench.scene import Scene, View

if TYPE_CHECKING:
    from sucre_bench.methods.sucre.sucre import Sucre

# Distances are alike if their percentile 95 is less than this many times their percentile 5.
_ALIKE = 1.5


@dataclass(frozen=True)
class OwnWater:
    """The exact fit of a method's options to one view of a scene."""

    options: Sucre
    scene: Scene
    view: View

    def solve(self, observations: Observations) -> tuple[Observations, Solution]:
        """Return the solution, and the observations that it explains: a lamp leaves some out."""
        matched = matched_sample(self.options, self.scene, self.view, observations)
        if self.options.lamp is True:
            return self._under_a_lamp(observations, matched)
        if self.options.exposure == "per_view":
            sample = observations if matched is None else matched
            start = fit(sample, **self.options.compute).water
            found = estimate_gains(sample, self.view.name, start, seed=self.options.seed)
            return self._with_gains(observations, matched, found)
        solution = self._solved(observations, matched, {})
        if matched is None:
            return self._determined(observations, solution, ())
        falloff = find_falloff(matched, self.view.name, solution.water, seed=self.options.seed)
        if falloff is None:
            return self._at_one_exposure(observations, matched, solution)
        if self.options.lamp == "auto" and falloff.is_sure:
            return self._in_even_light(matched, solution, falloff)
        removal = Removal.UNSURE if self.options.lamp == "auto" else Removal.NONE
        limit = sentence_of(falloff, removal)
        return self._determined(observations, _doubted(solution, falloff, removal), (limit,), (limit,))

    def _at_one_exposure(
        self, observations: Observations, matched: Observations, solution: Solution
    ) -> tuple[Observations, Solution]:
        """Return the solution with gains of views, where these explain the observations better."""
        limits = differing_exposure(matched, solution.water)
        tried = self.options.exposure == "auto"
        if tried and gains_may_explain(matched, self.view.name, solution.water, seed=self.options.seed):
            explained = self._with_gains_that_explain(observations, matched, solution)
            if explained is not None:
                return explained
        return self._determined(observations, solution, limits)

    def _determined(
        self, observations: Observations, solution: Solution, limits: Iterable[str], of_photograph: Iterable[str] = ()
    ) -> tuple[Observations, Solution]:
        """Return the solution, or the photograph if the water is a guess; of_photograph: limits that hold there too."""
        if is_guess(solution):  # no exposure is known without a water
            return observations, self._photograph(observations, solution).with_limits(of_photograph)
        return observations, solution.with_limits(limits)

    def _in_even_light(
        self, matched: Observations, without: Solution, falloff: Falloff
    ) -> tuple[Observations, Solution]:
        """Return the solution in even light, by the model of light that explains the observations best.

        without: the solution in falling light. A lamp tells nothing of pixels without depth, and colours=single_view
        knows no other way of the light than the distance.
        """
        with_rays = self.options.observe_with_rays(self.scene, self.view)
        matched = uncut(matched)
        light = UnevenLight(falloff, None)
        even = without_falloff(with_rays, falloff)
        if not self.options.fill and self.options.colours == "multi_view":
            lamp = estimate_lamp(matched, without.water, seed=self.options.seed)
            in_its_light = lit(with_rays, lamp.lamp)
            if explains_better(lamp, falloff) and in_its_light.n_repeated:
                light, even = UnevenLight(falloff, lamp), in_its_light
        even_matched = light.removed(matched)
        on_target = light.on(self.view)
        fit_in_even_light = replace(self, view=self.options.in_even_light(self.view, on_target))
        solution = fit_in_even_light._solved(even, even_matched, {})
        even, solution = fit_in_even_light._at_one_exposure(even, even_matched, solution)
        limits = (sentence_of(falloff, light.removal), *(_limits_of_lamp(matched) if light.lamp else ()))
        solution = replace(solution, about={**solution.about, **light.about()}, light=on_target)
        return even, self._with_doubted_veil(even, matched, solution).with_limits(limits)

    def _with_doubted_veil(self, even: Observations, sample: Observations, solution: Solution) -> Solution:
        """Return the solution in even light, without trust in its veil if distances are alike.

        Over flat ground the light takes part of the veil, whatever the standard errors of a water alone are. Colours
        then have the errors of noise: those of the veil are an offset of all.
        """
        uncertainty = solution.uncertainty
        if solution.is_photograph or (is_determined(uncertainty) and not _is_flat(sample)):
            return solution
        uncertainty = replace(uncertainty, is_weak=(True, True, True), covariance=np.zeros((3, 3, 3)))
        where = self.options.backend, self.options.device
        noise_only = colours_for_water(even, solution.water, uncertainty, *where)
        return replace(solution, deviation=noise_only.deviation, uncertainty=uncertainty)

    def _solved(self, observations: Observations, matched: Observations | None, about: Mapping[str, Any]) -> Solution:
        """Return the minimum; about: what else was found, for the record."""
        options = self.options
        solution = solve_exact(
            observations, matched=matched, physical=options.physical, robust=options.robust, **options.compute
        )
        found: dict[str, Any] = {"footprint": matched is not None, **about}
        if matched is not None:
            found["unexplained"] = float(robust_noise(matched, solution.water).mean())
        return replace(solution, about=solution.about | found)

    def _with_gains(
        self, observations: Observations, matched: Observations | None, found: Exposure
    ) -> tuple[Observations, Solution]:
        """Return the solution with the gains that were found, and the observations in the target's exposure."""
        even = AtOneExposure.of(observations, found.gains, found.water, self.view.name)
        limits = even.limits if found.is_separable else (found.limit, *even.limits)
        about = {"gains": dict(even.gains), "gains_separable": found.is_separable}
        even_matched = None if matched is None else corrected(matched, even.gains)
        solution = self._solved(even.observations, even_matched, about)
        if is_guess(solution):
            return even.observations, self._photograph(even.observations, solution)
        return even.observations, solution.with_limits(limits)

    def _with_gains_that_explain(
        self, observations: Observations, matched: Observations, without: Solution
    ) -> tuple[Observations, Solution] | None:
        """Return the solution with gains; None if gains explain little, or distances do not determine them.

        The target's gain is 1, so colours=single_view can use the water too.
        """
        try:
            found = estimate_gains(matched, self.view.name, without.water, seed=self.options.seed)
            even = corrected(matched, found.gains)
            if not found.is_separable or not gains_explain_better(even, found.water, without):
                return None
            if find_falloff(even, self.view.name, found.water, seed=self.options.seed):
                return None  # a lamp that moves with the camera can pass for gains
            with_views = self.options.observe(self.scene, self.view, observations)
            observations, solution = self._with_gains(with_views, matched, found)
        except SolveError:
            return None
        if solution.is_photograph:
            return None
        gains = solution.about["gains"].values()
        limit = f"exposure differs between views; gains of {min(gains):.2f} to {max(gains):.2f} were fitted"
        return observations, solution.with_limits([limit])

    def _photograph(self, observations: Observations, solution: Solution) -> Solution:
        intensities = self.options.intensities(self.view)
        return photograph_as_colours(observations, intensities, solution, self.options.backend, self.options.device)

    def _under_a_lamp(self, observations: Observations, matched: Observations | None) -> tuple[Observations, Solution]:
        """Return the solution in even light, where a lamp explains the observations better."""
        sample = observations if matched is None else matched
        found = estimate_lamp(sample, fit(sample, **self.options.compute).water, seed=self.options.seed)
        if not found.is_worth_it:
            say("no lamp: the observations are explained as well without one")
            return observations, self._solved(observations, matched, {"lamp": found.tested()})
        light = UnevenLight(None, found)
        observations = light.removed(observations)
        if not observations.n_repeated:
            raise SolveError("the lamp that was found leaves no pixel that two views show brightly; use lamp=false")
        even = None if matched is None else light.removed(matched)
        solution = replace(self._solved(observations, even, light.about()), light=light.on(self.view))
        solution = self._with_doubted_veil(observations, sample, solution)
        return observations, solution.with_limits(_limits_of_lamp(sample))


def _limits_of_lamp(sample: Observations) -> tuple[str, ...]:
    """Say how wrong attenuation may be if distances are alike.

    Light may fall with the square of its way d from the lamp, which the lobe does not model. Over the whole way of
    about 2 d, that is d log(d^-2) / d(2 d) = -1 / d, as much as attenuation of 1 / d.
    """
    if not _is_flat(sample):
        return ()
    near, middle, far = np.quantile(sample.distance, (0.05, 0.5, 0.95))
    return (
        f"distances are alike ({near:.3g} to {far:.3g} m), and a lamp's falloff with distance looks like attenuation "
        f"there: beta may be {1 / middle:.2g} 1/m too high",
    )


def _is_flat(sample: Observations) -> bool:
    """Return whether distances are alike."""
    near, far = np.quantile(sample.distance, (0.05, 0.95))
    return bool(far <= _ALIKE * near)


def _doubted(solution: Solution, falloff: Falloff, removal: Removal) -> Solution:
    """Return the solution with no trust in its water, and a record of the falloff."""
    uncertainty = replace(solution.uncertainty, is_weak=(True, True, True))
    about = solution.about | {"falloff": record_of(falloff, removal)}
    return replace(solution, uncertainty=uncertainty, about=about)
