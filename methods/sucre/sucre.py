"""SUCRe, solved exactly: the method `sucre` with all its options."""

from __future__ import annotations

import functools
import importlib
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sucre_bench import Restoration, Scene, SolveError, View, method
from sucre_bench.arrays import Array
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.imaging.fill import FillOption
from sucre_bench.machine.progress import say
from sucre_bench.methods.sucre.known_water import check_source, water_by, water_of
from sucre_bench.methods.sucre.options import (
    ColourOptions,
    ComputeOptions,
    FitOptions,
    PairingOptions,
    WaterOptions,
    Way,
    check,
    way_of,
)
from sucre_bench.methods.sucre.shrink_noisy_colours import LEAST_SPREAD, LEAST_SPREAD_LINEAR, prior_of
from sucre_bench.methods.sucre.sucre_paper import CITES
from sucre_bench.scene import Encoding

if TYPE_CHECKING:
    from sucre_bench.methods.sucre.exact import WaterFit
    from sucre_bench.methods.sucre.solvers import Solution
    from sucre_bench.multiview.observations import Observations
    from sucre_bench.multiview.observe import Options

# Pixels that the water is fitted to with matched footprints, and the fewest that are worth a fit of their own.
_MATCHED, _FEWEST_MATCHED = 20_000, 200


@method(
    needs={"depth", "poses"},
    requires=("numba", "torch"),
    display="stretch-1-99",
    cites=CITES,
    reads=("water", "water_from"),
)
@dataclass(frozen=True)
class Sucre(ComputeOptions, FillOption, ColourOptions, WaterOptions, PairingOptions, FitOptions):
    """SUCRe at its exact minimum: one water for all observations, and one colour for each pixel.

    The paper's model and least squares. Colours are eliminated, and Levenberg-Marquardt finds the water from several
    starts. Attenuation and backscatter stay positive, the veiling light between 0 and 1.
    """

    def __post_init__(self) -> None:
        check(self, type(self).__plugin__.name)  # type: ignore[attr-defined]
        if self.water_from:
            check_source(self.water_from)

    def warm_up(self) -> None:
        """Import and compile everything that the first view needs."""
        from sucre_bench.methods.sucre.warm_up import compile_for

        if way_of(self) in (Way.ADAM, Way.CLOSED_FORM):
            importlib.import_module("torch")
        compile_for(self.backend, self.device, self._pairing)

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return J, NaN where the view has no depth, the water, and the standard deviation of J.

        info: see `to_restoration.restoration`; seconds of each stage besides.
        Raises NotApplicableError when no pixel has depth or none is seen twice, SolveError when the fit fails,
        InputError for a water that cannot be read.
        """
        from sucre_bench.methods.sucre.guessed import guessed
        from sucre_bench.methods.sucre.to_restoration import named, restoration, with_residuals

        observations = self._observe(scene, view)
        stages = {"read": observations.read_s, "pair": observations.pair_s}
        started = time.perf_counter()
        with named(view):
            observations, solution = self._solve(scene, view, observations)
            if self.residuals:
                solution = with_residuals(observations, solution, self.seed)
            if self.colours == "single_view":
                observations, solution = self._single_view(view, solution)
            else:
                solution = self._refined(view, observations, solution)
        spread = LEAST_SPREAD_LINEAR if self._fitted(view) == "linear" else LEAST_SPREAD
        shrinks = self.prior and not solution.is_photograph
        prior = prior_of(solution.J, solution.deviation, spread) if shrinks else None
        if prior is not None:
            J, deviation = prior.posterior(solution.J, solution.deviation)
            solution = replace(solution, J=J, deviation=deviation)
        if self._decodes(view):
            solution = _encoded(solution)
        stages["solve"] = time.perf_counter() - started
        restored = restoration(view, observations, solution, stages, self._fitted(view))
        return guessed(restored, view, prior) if self.fill else restored

    def _refined(self, view: View, observations: Observations, solution: Solution) -> Solution:
        """Return colours of many views with calibrated standard deviations and without gaps, where chosen."""
        if solution.is_photograph:
            return solution
        from sucre_bench.methods.sucre.calibrated_noise import calibrated
        from sucre_bench.methods.sucre.even_gaps import even_deviation, evened

        if self.prior or self.robust:
            solution = calibrated(observations, solution, decoded=self._decodes(view))
        if not self.even:
            return solution
        if solution.weight is not None:
            observations = replace(observations, weight=solution.weight)
        J = evened(observations, solution.J, solution.water, view.name)
        return replace(solution, J=J, deviation=even_deviation(observations, solution.deviation))

    def _observe(self, scene: Scene, view: View) -> Observations:
        from sucre_bench.multiview.cache import paired

        return paired(scene, view, self.pairs, **self._pairing)

    @property
    def _pairing(self) -> Options:
        return {
            "rule": self.pairing,
            "tolerance": self.tolerance,
            "encoding": self.encoding,
            "with_ray": self.lamp,
            "with_view": self.even or self.exposure == "per_view",
        }

    def _solve(self, scene: Scene, view: View, observations: Observations) -> tuple[Observations, Solution]:
        """Return the solution, and the observations that it explains: a lamp leaves some out."""
        from sucre_bench.methods.sucre import solvers

        where = (self.backend, self.device)
        match way_of(self):
            case Way.EXACT:
                return self._solve_exactly(scene, view, observations)
            case Way.ADAM:
                start = solvers.start_of(observations, self._intensities(view))
                solution = solvers.solve_adam(observations, start, self.steps, self.lr, "sum", *where)
            case Way.CLOSED_FORM:
                solution = solvers.solve_adam_closed_form(observations, self.steps, self.lr, *where)
            case Way.SHARED:
                shared = _shared_fit(scene, self)
                if isinstance(shared, SolveError):
                    raise shared
                solution = solvers.colours_for_water(observations, shared.water, shared.uncertainty, *where)
            case Way.KNOWN:
                read = (self.water_from or self.water, scene, view, self._fitted(view))
                water = water_by(*read) if self.water_from else water_of(*read)
                solution = solvers.colours_for_water(observations, water, None, *where)
        return observations, solution

    def _solve_exactly(self, scene: Scene, view: View, observations: Observations) -> tuple[Observations, Solution]:
        from sucre_bench.methods.sucre.exposure import differing_exposure
        from sucre_bench.methods.sucre.robust import robust_noise
        from sucre_bench.methods.sucre.solvers import solve_exact
        from sucre_bench.methods.sucre.undetermined_water import gains_explain_better, is_guess, photograph_as_colours

        matched = self._matched(scene, view, observations)
        about: dict[str, Any] = {"footprint": matched is not None}
        limits: tuple[str, ...] = ()
        if self.lamp:
            observations, matched, found = self._without_lamp(observations, matched)
            about |= found
        if self.exposure == "per_view":
            observations, matched, found, limits = self._at_equal_exposure(view, observations, matched)
            about |= found
        solution = solve_exact(
            observations, matched=matched, physical=self.physical, robust=self.robust, **self._compute
        )
        if matched is not None:
            about["unexplained"] = float(robust_noise(matched, solution.water).mean())
            solution = replace(solution, about=solution.about | about)
        if matched is not None and self.exposure != "per_view" and not self.lamp:
            limits = differing_exposure(matched, solution.water)
            if limits and self.exposure == "auto":
                with_gains = self._with_gains(scene, view, observations)
                if with_gains is not None and gains_explain_better(with_gains[1], solution):
                    return with_gains
        if not self.lamp and is_guess(solution):
            solution = photograph_as_colours(observations, self._intensities(view), solution, self.backend, self.device)
            limits = ()  # no exposure is known without a water
        uncertainty = replace(solution.uncertainty, limits=(*solution.uncertainty.limits, *limits))
        return observations, replace(solution, uncertainty=uncertainty, about=solution.about | about)

    def _with_gains(self, scene: Scene, view: View, observations: Observations) -> tuple[Observations, Solution] | None:
        """Return the solution with one gain for each view; None if distances do not determine the gains.

        The target's gain is 1, so colours=single_view can use the water too.
        """
        per_view = replace(self, exposure="per_view", colours="multi_view")
        if observations.view is None:
            observations = per_view._observe(scene, view)
        try:
            observations, solution = per_view._solve_exactly(scene, view, observations)
        except SolveError:
            return None
        if solution.is_photograph or not solution.about["gains_separable"]:
            return None
        gains = solution.about["gains"].values()
        limit = f"exposure differs between views; gains of {min(gains):.2f} to {max(gains):.2f} were fitted"
        uncertainty = replace(solution.uncertainty, limits=(*solution.uncertainty.limits, limit))
        return observations, replace(solution, uncertainty=uncertainty)

    def _matched(self, scene: Scene, view: View, observations: Observations) -> Observations | None:
        """Return the sample with matched footprints; None without the option, or where too few pixels have one."""
        from sucre_bench.multiview.footprints import matched_footprints

        n = observations.n_repeated
        if not self.footprint or n < _FEWEST_MATCHED:
            return None
        places = np.random.default_rng(self.seed).choice(n, min(n, _MATCHED), replace=False)
        views = [other for other in scene.views if other.name in set(observations.views)]
        options = self._pairing
        options["with_view"] = True
        found = matched_footprints(view, views, observations.pixels[places], **options)
        return found if found.n_repeated >= _FEWEST_MATCHED else None

    @property
    def _compute(self) -> dict[str, Any]:
        """Options that every fit has."""
        return {"backend": self.backend, "device": self.device, "seed": self.seed}

    def _single_view(self, view: View, solution: Solution) -> tuple[Observations, Solution]:
        """Return the image's own observations, and their colours in the water of a solution."""
        from sucre_bench.methods.sucre.solvers import colours_for_water
        from sucre_bench.multiview.observe import observe

        in_target = observe(view, [view], **self._pairing)
        alone = colours_for_water(in_target, solution.water, solution.uncertainty, self.backend, self.device)
        return in_target, replace(alone, about=solution.about, is_photograph=solution.is_photograph)

    def _without_lamp(
        self, observations: Observations, matched: Observations | None
    ) -> tuple[Observations, Observations | None, dict[str, Any]]:
        """Return both kinds of observations in even light, where a lamp explains them better, and its record."""
        from sucre_bench.methods.sucre.exact import fit
        from sucre_bench.methods.sucre.lamp import estimate, lit

        sample = observations if matched is None else matched
        found = estimate(sample, fit(sample, **self._compute).water, seed=self.seed)
        about = {"noise": found.noise, "noise_without": found.noise_without}
        if not found.is_worth_it:
            say("no lamp: the observations are explained as well without one")
            return observations, matched, {"lamp": about | {"found": False}}
        lamp = {"lamp_from_cam": found.lamp.lamp_from_cam.tolist(), "precision": found.lamp.precision.tolist()}
        observations = lit(observations, found.lamp)
        if not observations.n_repeated:
            raise SolveError("the lamp that was found leaves no pixel that two views show brightly; use lamp=false")
        even = None if matched is None else lit(matched, found.lamp)
        return observations, even, {"lamp": about | {"found": True} | lamp}

    def _at_equal_exposure(
        self, view: View, observations: Observations, matched: Observations | None
    ) -> tuple[Observations, Observations | None, dict[str, Any], tuple[str, ...]]:
        """Return both kinds of observations in the target's exposure, a record of the gains, and their limits."""
        from sucre_bench.methods.sucre.exact import fit
        from sucre_bench.methods.sucre.exposure import corrected, estimate

        sample = observations if matched is None else matched
        found = estimate(sample, view.name, fit(sample, **self._compute).water, seed=self.seed)
        about = dict(zip(found.names, found.gains.tolist(), strict=True))
        limits = () if found.is_separable else (found.limit,)
        even = None if matched is None else corrected(matched, found)
        return corrected(observations, found), even, {"gains": about, "gains_separable": found.is_separable}, limits

    def _intensities(self, view: View) -> Array:
        """Return the target's intensities (H W, 3) in the encoding that is fitted."""
        rgb = view.rgb.reshape(-1, 3)
        return srgb_decode(rgb) if self._decodes(view) else rgb

    def _fitted(self, view: View) -> Encoding:
        """The encoding of the intensities that are fitted."""
        return "linear" if self.encoding == "linear" else view.encoding

    def _decodes(self, view: View) -> bool:
        return self._fitted(view) != view.encoding


def _encoded(solution: Solution) -> Solution:
    """Encode the colours of a fit to linear light as the view is; the curve continues below 0 and above 1."""
    J = srgb_encode(solution.J)
    return replace(solution, J=J, deviation=np.abs(srgb_encode(solution.J + solution.deviation) - J))


@functools.lru_cache(maxsize=4)  # every view of the scene asks for it
def _shared_fit(scene: Scene, sucre: Sucre) -> WaterFit | SolveError:
    """Return the common water; or why there is none, which is kept too, since finding out takes as long."""
    from sucre_bench.methods.sucre.exact import fit
    from sucre_bench.methods.sucre.shared_water import samples

    try:
        targets = samples(
            scene,
            lambda view: sucre._observe(scene, view),
            lambda view, observations: sucre._matched(scene, view, observations),
            most=sucre.shared_views,
            singles=sucre.physical,
            seed=sucre.seed,
        )
        to_fit = [sharp if matched is None else matched for sharp, matched in targets]
        held = [None if matched is None else sharp for sharp, matched in targets]
        return fit(to_fit, physical=sucre.physical, sharp=held, **sucre._compute)
    except SolveError as fault:
        return fault
