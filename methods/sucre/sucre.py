"""The method `sucre`: the least-squares minimum of SUCRe's model, with all its options."""

from __future__ import annotations

import functools
import importlib
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sucre_bench import Arrays, Restoration, Scene, SolveError, View, method
from sucre_bench.arrays import Array
from sucre_bench.imaging.display import normalisation
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.imaging.fill import FillOption
from sucre_bench.methods.sucre.known_water import KnownWater, check_file, check_source, water_by, water_of
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
from sucre_bench.methods.sucre.shrink_noisy_colours import LEAST_SPREAD, LEAST_SPREAD_LINEAR, ImagePrior, prior_of
from sucre_bench.methods.sucre.sucre_paper import CITES
from sucre_bench.plugins.call_method import display_of
from sucre_bench.scene import Encoding

if TYPE_CHECKING:
    from sucre_bench.methods.sucre.exact import WaterFit
    from sucre_bench.methods.sucre.solvers import Solution
    from sucre_bench.methods.sucre.uneven_light import TargetLight
    from sucre_bench.multiview.observations import Observations
    from sucre_bench.multiview.observe import Options


@method(
    needs={"depth", "poses"},
    requires=("numba", "torch"),
    display="stretch-1-99",
    cites=CITES,
    reads=("water", "water_from"),
)
@dataclass(frozen=True)
class Sucre(ComputeOptions, FillOption, ColourOptions, WaterOptions, PairingOptions, FitOptions):
    """This project's method on SUCRe's model, to measure the water: one water for a view, one colour for each pixel.

    `sucre_paper` is SUCRe as published; its authors have not seen this method. The model and its least squares are the
    paper's. Colours are eliminated, and Levenberg-Marquardt finds the water from several starts. Attenuation and
    backscatter stay positive, the veiling light between 0 and 1. Footprints of observations, exposure, uneven light and
    weak priors are this project's.
    """

    def __post_init__(self) -> None:
        check(self, type(self).__plugin__.name)  # type: ignore[attr-defined]
        if self.water_from:
            check_source(self.water_from)
        if self.water not in ("own", "shared", "truth"):
            check_file(self.water)

    def warm_up(self) -> None:
        """Import and compile everything that the first view needs."""
        from sucre_bench.methods.sucre.warm_up import compile_for

        if way_of(self) in (Way.ADAM, Way.CLOSED_FORM):
            importlib.import_module("torch")
        compile_for(self.backend, self.device, self.pairing_with())

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return J, NaN where the view has no depth, the water, and the standard deviation of J.

        info: see `to_restoration.restoration`; seconds of each stage besides.
        Raises NotApplicableError when no pixel has depth or none is seen twice, SolveError when the fit fails,
        InputError for a water that cannot be read.
        """
        from sucre_bench.methods.sucre.fill_without_depth import fill_pixels_without_depth
        from sucre_bench.methods.sucre.to_restoration import named, restoration, with_residuals

        observations = self.observe(scene, view)
        stages = {"read": observations.read_s, "pair": observations.pair_s}
        started = time.perf_counter()
        with named(view):
            observations, solution = self._solve(scene, view, observations)
            if solution.light is not None:
                view = self.in_even_light(view, solution.light)
            solution = self._with_limit_of_veil(observations, solution)
            if self.residuals:
                solution = with_residuals(observations, solution, self.seed)
            if self.colours == "single_view":
                observations, solution = self._single_view(view, solution)
            else:
                solution = self._refined(view, observations, solution)
        solution, prior, black = self._with_prior(view, solution)
        if self._decodes(view):
            solution = _encoded(solution)
        stages["solve"] = time.perf_counter() - started
        restored = restoration(view, observations, solution, stages, self, self._fitted(view))
        if self.fill:
            restored = fill_pixels_without_depth(restored, view, prior, black)
        return restored if black is None else _with_unknown_veil(restored)

    def _with_limit_of_veil(self, observations: Observations, solution: Solution) -> Solution:
        """Return the solution, with a limit that names the unknown veil if it would stay visible in the picture.

        Some displays subtract an offset of each channel. They remove such a veil, and no limit is needed.
        """
        from sucre_bench.methods.sucre.undetermined_water import UNKNOWN_VEIL, has_unknown_veil, is_in_air

        if solution.light is not None or not has_unknown_veil(solution) or is_in_air(observations, solution):
            return solution
        if normalisation(display_of(self)).removes_offsets:
            return solution
        return solution.with_limits([UNKNOWN_VEIL])

    def _with_prior(self, view: View, solution: Solution) -> tuple[Solution, ImagePrior | None, Array | None]:
        """Return the solution with less noise in its colours (prior=true), the prior, and the black (3,) subtracted.

        The prior keeps brightness. So in uneven light, whose veil is an offset, a black is subtracted first.
        """
        from sucre_bench.methods.sucre.undetermined_water import has_unknown_veil, without_darkest

        black = prior = None
        if self.prior and solution.light is not None and (solution.is_photograph or has_unknown_veil(solution)):
            solution, black = without_darkest(solution)
        if self.prior and not solution.is_photograph:
            spread = LEAST_SPREAD_LINEAR if self._fitted(view) == "linear" else LEAST_SPREAD
            prior = prior_of(solution.J, solution.deviation, spread)
        if prior is not None:
            J, deviation = prior.posterior(solution.J, solution.deviation)
            solution = replace(solution, J=J, deviation=deviation)
        return solution, prior, black

    def _refined(self, view: View, observations: Observations, solution: Solution) -> Solution:
        """Return colours of many views with calibrated standard deviations and without gaps, where chosen.

        view: in even light, as the observations are.
        """
        if solution.is_photograph:
            return solution
        from sucre_bench.methods.sucre.calibrated_noise import calibrated
        from sucre_bench.methods.sucre.depth_edges import Target, corrected_edges
        from sucre_bench.methods.sucre.even_gaps import even_deviation, evened
        from sucre_bench.methods.sucre.follow_best_channel import followed

        if self.prior or self.robust:
            solution = calibrated(observations, solution, decoded=self._decodes(view))
        if solution.weight is not None:
            observations = replace(observations, weight=solution.weight)
        way = view.distance if solution.light is None else solution.light.way
        J, deviation = solution.J, solution.deviation
        if self.even:
            J = evened(observations, J, solution.water, view.name)
        if self.edges and not self.robust:
            target = Target(self.intensities(view).reshape(*observations.shape, 3), view.rgb, way)
            images = corrected_edges(target, observations.image(J), observations.image(deviation), solution.water)
            J, deviation = (image.reshape(-1, 3)[observations.pixels].T for image in images)
        if self.even:
            deviation = even_deviation(observations, deviation, way)
        if self.prior:
            images = followed(observations.image(J), observations.image(deviation))
            J, deviation = (image.reshape(-1, 3)[observations.pixels].T for image in images)
        return replace(solution, J=J, deviation=deviation)

    def observe(self, scene: Scene, view: View, *, with_view: bool = False, with_ray: bool = False) -> Observations:
        """Return the observations of a view; with their views and rays in any case, if asked for."""
        from sucre_bench.multiview.stored_pairs import paired

        return paired(scene, view, self.pairs, **self.pairing_with(with_view=with_view, with_ray=with_ray))

    def with_views(self, scene: Scene, view: View, observations: Observations) -> Observations:
        """Return the observations of a view with their views; they are paired again only if they have none."""
        return observations if observations.view is not None else self.observe(scene, view, with_view=True)

    def pairing_with(self, *, with_view: bool = False, with_ray: bool = False) -> Options:
        """Return the options of pairing."""
        return {
            "rule": self.pairing,
            "tolerance": self.tolerance,
            "encoding": self.encoding,
            "with_ray": with_ray or self.lamp is True,
            "with_view": with_view or self.even or self.exposure == "per_view",
        }

    def _solve(self, scene: Scene, view: View, observations: Observations) -> tuple[Observations, Solution]:
        """Return the solution, and the observations that it explains: a lamp leaves some out."""
        from sucre_bench.methods.sucre import solvers
        from sucre_bench.methods.sucre.own_water import OwnWater

        where = (self.backend, self.device)
        match way_of(self):
            case Way.EXACT:
                return OwnWater(self, scene, view).solve(observations)
            case Way.ADAM:
                start = solvers.start_of(observations, self.intensities(view))
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
                known = water_by(*read) if self.water_from else water_of(*read)
                return self._in_known_water(known, scene, view, observations)
        return observations, solution

    def _in_known_water(
        self, known: KnownWater, scene: Scene, view: View, observations: Observations
    ) -> tuple[Observations, Solution]:
        """Return the colours in a known water, and the observations, in the target's exposure if it has gains."""
        from sucre_bench.methods.sucre.apply_gains import AtOneExposure
        from sucre_bench.methods.sucre.solvers import colours_for_water

        if not known.gains:
            return observations, colours_for_water(observations, known.water, None, self.backend, self.device)
        even = AtOneExposure.of(self.with_views(scene, view, observations), known.gains, known.water, view.name)
        solution = colours_for_water(even.observations, known.water, None, self.backend, self.device)
        return even.observations, replace(solution, about=solution.about | {"gains": dict(even.gains)}).with_limits(
            even.limits
        )

    @property
    def compute(self) -> dict[str, Any]:
        """Options that every fit has."""
        return {"backend": self.backend, "device": self.device, "seed": self.seed}

    def _single_view(self, view: View, solution: Solution) -> tuple[Observations, Solution]:
        """Return the image's own observations, and their colours in the water of a solution."""
        from sucre_bench.methods.sucre.solvers import colours_for_water
        from sucre_bench.multiview.observe import observe

        in_target = observe(view, [view], **self.pairing_with())
        alone = colours_for_water(in_target, solution.water, solution.uncertainty, self.backend, self.device)
        return in_target, replace(
            alone, about=solution.about, is_photograph=solution.is_photograph, light=solution.light
        )

    def intensities(self, view: View) -> Array:
        """Return the target's intensities (H W, 3) in the encoding that is fitted."""
        rgb = view.rgb.reshape(-1, 3)
        return srgb_decode(rgb) if self._decodes(view) else rgb

    def in_even_light(self, view: View, light: TargetLight) -> View:
        """Return the view as even light would show it; colours may exceed 1, and are NaN where it is dark."""
        linear = self.intensities(view).reshape(view.rgb.shape) / light.light[..., None]
        rgb = srgb_encode(linear) if self._decodes(view) else linear
        return replace(view, pixels=Arrays(rgb.astype(np.float32), view.depth, view.reference))

    def _fitted(self, view: View) -> Encoding:
        """The encoding of the intensities that are fitted."""
        return "linear" if self.encoding == "linear" else view.encoding

    def _decodes(self, view: View) -> bool:
        return self._fitted(view) != view.encoding


def _encoded(solution: Solution) -> Solution:
    """Encode the colours of a fit to linear light as the view is; the curve continues below 0 and above 1."""
    J = srgb_encode(solution.J)
    return replace(solution, J=J, deviation=np.abs(srgb_encode(solution.J + solution.deviation) - J))


def _with_unknown_veil(restoration: Restoration) -> Restoration:
    """Return the restoration with a water that tells no veil."""
    assert restoration.water is not None
    unknown = np.full(3, np.nan)
    return replace(restoration, water=replace(restoration.water, veiling_light=unknown, backscatter=unknown))


@functools.lru_cache(maxsize=4)  # every view of the scene asks for it
def _shared_fit(scene: Scene, sucre: Sucre) -> WaterFit | SolveError:
    """Return the common water; or why there is none, which is kept too, since finding out takes as long."""
    from sucre_bench.methods.sucre.exact import fit
    from sucre_bench.methods.sucre.samples import matched_sample
    from sucre_bench.methods.sucre.shared_water import samples_of_targets

    try:
        targets = samples_of_targets(
            scene,
            lambda view: sucre.observe(scene, view),
            lambda view, observations: matched_sample(sucre, scene, view, observations) if sucre.footprint else None,
            most=sucre.shared_views,
            singles=sucre.physical,
            seed=sucre.seed,
        )
        to_fit = [sharp if matched is None else matched for sharp, matched in targets]
        held = [None if matched is None else sharp for sharp, matched in targets]
        return fit(to_fit, physical=sucre.physical, sharp=held, **sucre.compute)
    except SolveError as fault:
        return fault
