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
from sucre_bench.methods.sucre.falloff import Falloff, find_falloff, uncut
from sucre_bench.methods.sucre.lamp import LampFit
from sucre_bench.methods.sucre.lamp import estimate as estimate_lamp
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.robust import robust_noise
from sucre_bench.methods.sucre.solution import Solution, colours_for_water, matched_sample, solve_exact
from sucre_bench.methods.sucre.sucre import typed
from sucre_bench.methods.sucre.undetermined_water import (
    gains_explain_better,
    gains_may_explain,
    is_guess,
    photograph_as_colours,
)
from sucre_bench.methods.sucre.uneven_light import (
    Removal,
    UnevenLight,
    explains_better,
    is_flat,
    limits_of_lamp,
    record_of,
    sentence_of,
)
from sucre_bench.multiview.observations import Observations
from sucre_bench.scene import Scene, View

if TYPE_CHECKING:
    from sucre_bench.methods.sucre.sucre import Sucre


@dataclass(frozen=True)
class OwnWater:
    """The exact fit of a method's options to one view of a scene."""

    options: Sucre
    scene: Scene
    view: View

    def solve(self, observations: Observations) -> tuple[Observations, Solution]:
        """Return the solution, and the observations that it explains: a lamp leaves some out."""
        tested = self._footprints(observations)
        matched = tested if self.options.footprint else None
        if self.options.lamp is True:
            return self._under_a_lamp(observations, matched)
        sample = observations if matched is None else matched
        solution = None if self.options.exposure == "per_view" else self._solved(observations, matched, {})
        water = self._water_of(sample) if solution is None else solution.water
        falloff = None if tested is None else find_falloff(tested, self.view.name, water, seed=self.options.seed)
        if falloff is not None and matched is not None and self.options.lamp == "auto" and falloff.is_sure:
            return self._in_even_light(matched, water, falloff)
        if solution is None:
            observations, solution = self._at_gains_of_views(observations, matched, water)
            return observations, solution if falloff is None else self._doubted(solution, falloff)
        if falloff is not None:
            limit = sentence_of(falloff, self._why_it_stays, self.options)
            return self._determined(observations, self._doubted(solution, falloff), (), (limit,))
        if matched is None:
            return self._determined(observations, solution, ())
        return self._at_one_exposure(observations, matched, solution)

    def _water_of(self, sample: Observations) -> WaterParameters:
        """Return the water of a sample in even light and one exposure, to start other fits from."""
        return fit(sample, **self.options.compute).water

    def _footprints(self, observations: Observations) -> Observations | None:
        """Return the sample with matched footprints, to fit the water to or only to look for a falloff."""
        is_needed = self.options.footprint or self.options.lamp == "auto"
        return matched_sample(self.options, self.scene, self.view, observations) if is_needed else None

    @property
    def _why_it_stays(self) -> Removal:
        """Why a falloff that was found is not removed."""
        if self.options.lamp is False:
            return Removal.NONE
        return Removal.UNSURE if self.options.footprint else Removal.SINGLE_PIXELS

    def _doubted(self, solution: Solution, falloff: Falloff) -> Solution:
        """Return the solution with no trust in its water, and what to say of a falloff that stays."""
        why = self._why_it_stays
        about = solution.about | {"falloff": record_of(falloff, why)}
        uncertainty = replace(solution.uncertainty, is_weak=(True, True, True))
        return replace(solution, uncertainty=uncertainty, about=about).with_limits(
            (sentence_of(falloff, why, self.options),)
        )

    def _at_gains_of_views(
        self, observations: Observations, matched: Observations | None, water: WaterParameters
    ) -> tuple[Observations, Solution]:
        """Return the solution with gains of views (exposure=per_view); water: fitted without."""
        sample = observations if matched is None else matched
        found = estimate_gains(sample, self.view.name, water, seed=self.options.seed)
        return self._with_gains(observations, matched, found)

    def _at_one_exposure(
        self, observations: Observations, matched: Observations, solution: Solution
    ) -> tuple[Observations, Solution]:
        """Return the solution with gains of views, where these explain the observations better."""
        limits = self._differing_exposure(matched, solution.water)
        tried = self.options.exposure == "auto"
        if tried and gains_may_explain(matched, self.view.name, solution.water, seed=self.options.seed):
            explained = self._with_gains_that_explain(observations, matched, solution)
            if explained is not None:
                return explained
        return self._determined(observations, solution, limits)

    def _differing_exposure(self, matched: Observations, water: WaterParameters) -> tuple[str, ...]:
        """Return what to say if the exposures of views differ, and the options that explain it."""
        said = differing_exposure(matched, water)
        fits = [(typed(self.options, "exposure", "per_view"), "fits it")]
        fits += [(typed(self.options, "lamp", True), "fits a lamp on the camera")]
        return ("; ".join([said, *(f"{word} {what}" for word, what in fits if word)]),) if said else ()

    def _determined(
        self, observations: Observations, solution: Solution, limits: Iterable[str], of_photograph: Iterable[str] = ()
    ) -> tuple[Observations, Solution]:
        """Return the solution, or the photograph if the water is a guess; of_photograph: limits that hold there too."""
        if is_guess(solution):  # no exposure is known without a water
            return observations, self._photograph(observations, solution).with_limits(of_photograph)
        return observations, solution.with_limits(limits)

    def _in_even_light(
        self, matched: Observations, water: WaterParameters, falloff: Falloff
    ) -> tuple[Observations, Solution]:
        """Return the solution in even light, by the model of light that explains the observations best.

        water: fitted in falling light. The lobe of a lamp leaves its falloff with distance to beta. So a lamp serves
        only if the water in its light is determined: the photograph, which replaces an unknown water, would keep that
        falloff. The place in the image takes all.
        """
        with_rays = self.options.observe(self.scene, self.view, with_view=True, with_ray=True)
        matched = uncut(matched)
        lamp = self._better_lamp(matched, water, falloff)
        if lamp is not None:
            even, solution = self._in_the_light_of(UnevenLight(falloff, lamp), with_rays, matched)
            if even.n_repeated and not solution.is_photograph:
                return even, solution
        return self._in_the_light_of(UnevenLight(falloff, None), with_rays, matched)

    def _better_lamp(self, matched: Observations, water: WaterParameters, falloff: Falloff) -> LampFit | None:
        """Return the lamp that explains the observations better than the place in the image; None without one.

        A lamp tells nothing of pixels without depth, and colours=single_view knows no other way of the light than the
        distance.
        """
        if self.options.fill or self.options.colours == "single_view":
            return None
        lamp = estimate_lamp(matched, water, seed=self.options.seed)
        return lamp if explains_better(lamp, falloff) else None

    def _in_the_light_of(
        self, light: UnevenLight, with_rays: Observations, matched: Observations
    ) -> tuple[Observations, Solution]:
        """Return the solution for observations that are brought to even light, and these; with_rays: all of them."""
        assert light.falloff is not None
        even, even_matched, on_target = light.removed(with_rays), light.removed(matched), light.on(self.view)
        in_even_light = replace(self, view=self.options.in_even_light(self.view, on_target))
        if self.options.exposure == "per_view":
            even, solution = in_even_light._at_gains_of_views(even, even_matched, self._water_of(even_matched))
        else:
            even, solution = in_even_light._at_one_exposure(
                even, even_matched, in_even_light._solved(even, even_matched, {})
            )
        limits = (
            sentence_of(light.falloff, light.removal, self.options),
            *(limits_of_lamp(matched) if light.lamp else ()),
        )
        solution = replace(solution, about={**solution.about, **light.about()}, light=on_target)
        return even, self._with_doubted_veil(even, matched, solution).with_limits(limits)

    def _with_doubted_veil(self, even: Observations, sample: Observations, solution: Solution) -> Solution:
        """Return the solution in even light, without trust in its veil if distances are alike.

        Over flat ground the light takes part of the veil, whatever the standard errors of a water alone are. Colours
        then have the errors of noise: those of the veil are an offset of all.
        """
        uncertainty = solution.uncertainty
        if solution.is_photograph or (is_determined(uncertainty) and not is_flat(sample)):
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
            with_views = self.options.with_views(self.scene, self.view, observations)
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
        where = self.options.backend, self.options.device
        return photograph_as_colours(observations, intensities, solution, typed(self.options, "lamp", True), *where)

    def _under_a_lamp(self, observations: Observations, matched: Observations | None) -> tuple[Observations, Solution]:
        """Return the solution in even light, where a lamp explains the observations better."""
        sample = observations if matched is None else matched
        found = estimate_lamp(sample, self._water_of(sample), seed=self.options.seed)
        if not found.is_worth_it:
            say("no lamp: the observations are explained as well without one")
            return observations, self._solved(observations, matched, {"lamp": found.tested()})
        light = UnevenLight(None, found)
        observations = light.removed(observations)
        if not observations.n_repeated:
            raise SolveError(
                "the lamp that was found leaves no pixel that two views show brightly; use method.lamp=false"
            )
        even = None if matched is None else light.removed(matched)
        solution = replace(self._solved(observations, even, light.about()), light=light.on(self.view))
        solution = self._with_doubted_veil(observations, sample, solution)
        return observations, solution.with_limits(limits_of_lamp(sample))
