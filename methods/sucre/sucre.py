"""The methods `sucre` and `sucre_plus`: this project's fit of SUCRe's model, its options, and how they go together."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sucre_bench import Arrays, InputError, Restoration, Scene, View, method
from sucre_bench.arrays import Array
from sucre_bench.camera import Camera, pixel_rays
from sucre_bench.imaging.display import normalisation
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.imaging.fill import FillOption
from sucre_bench.machine.compute import Device
from sucre_bench.machine.packages import require
from sucre_bench.methods.sucre.known_water import check_source, shared_water, water_of
from sucre_bench.methods.sucre.light import AUTO, EVEN, Light, Parts, parts_of
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.paper import CITES
from sucre_bench.methods.sucre.passes import Backend
from sucre_bench.methods.sucre.refine_noise import (
    LEAST_SPREAD,
    LEAST_SPREAD_LINEAR,
    ImagePrior,
    prior_of,
    specks_of,
)
from sucre_bench.plugins.call_method import display_of
from sucre_bench.scene import Encoding

if TYPE_CHECKING:
    from sucre_bench.methods.sucre.solution import Solution
    from sucre_bench.multiview.observations import Observations
    from sucre_bench.multiview.observe import Options

_AFTER = f"by this project, after {CITES}; its authors have not seen it"


@method(
    needs={"depth", "poses"},
    requires=("numba",),
    may_use=("jax", "torch"),
    display="stretch-1-99",
    cites=_AFTER,
    reads=("water",),
)
@dataclass(frozen=True)
class Sucre(FillOption):
    """This project's method on SUCRe's model, to measure the water: one water for a view, one colour for each pixel.

    `sucre_paper` is SUCRe as published; its authors have not seen this method. The model and its least squares are the
    paper's. Colours are eliminated, and Levenberg-Marquardt finds the water from several starts. Attenuation and
    backscatter stay positive, the veiling light between 0 and 1. Footprints of observations, exposure, uneven light and
    weak priors are this project's.
    """

    solver: Literal["exact"] | str = "exact"
    """exact: least squares to the minimum, the only choice; the paper's Adam is the method sucre_paper."""

    footprint: bool = True
    """Fit the water to observations that average the same ground as the farthest view; colours stay sharp. false: fit
    single pixels, which makes attenuation too high. Needs water=own or shared."""

    physical: bool = False
    """Keep colours above zero, up to noise; a veil brighter than the darkest pixels raises the cost.
    With footprint=true, only if the observations are then explained nearly as well."""

    one_coefficient: bool = False
    """Fit the paper's eq. 1, in which backscatter has the coefficient of attenuation: gamma = beta (water=own or
    shared, without a strobe)."""

    robust: bool | Literal["auto"] = "auto"
    """true: give less weight to observations that do not fit, such as animals that move and pixels paired wrongly;
    auto: only if these lie together in single views, or if noise explains the others; false: never. A colour that is
    too bright for a surface stays unknown, except with false; refine=true guesses it."""

    light: str = "auto"
    """What differs in the light of the views, fitted with the water: exposure (a gain for each view),
    white_balance (three), lens (vignetting), strobe (the only light, beside the camera), or some joined by +; even:
    nothing; auto: what explains pixels that the fit has not seen (footprint=true)."""

    pairing: Literal["mutual", "depth"] = "mutual"
    """mutual: the paper's rule, pixels that project onto each other; depth: points whose depths agree within 3 %, with
    interpolated colours, and more observations if views differ in scale."""

    encoding: Literal["auto", "view", "linear"] = "auto"
    """view: fit intensities as stored, as the paper does; linear: fit linear light, decoded from sRGB; auto: linear
    light only if it leaves less than 95 % of the residuals, with a gain for each view too (water=own)."""

    water: Literal["own", "shared", "truth"] | str = "own"
    """own: fit each image; shared: fit many images of the scene together; truth: the dataset's true water; METHOD: the
    water that another method estimates on each image with its default options; a .json or .npz file with B, beta and
    gamma; or a folder with one such file for each view, like restored/ of an earlier run."""

    colours: Literal["multi_view", "single_view"] = "multi_view"
    """multi_view: compute each colour from all its observations; single_view: from the image's own intensity alone,
    with the same water."""

    refine: bool = False
    """Refine colours after the fit. Dots, lines and steps go that gaps of single views make. Edges and animals show
    what the image shows, where other views contradict it (not with robust=true). Noise goes: in each window by the
    channel that is known best, then towards the image's mean colour."""

    backend: Backend = "auto"
    """Array library: numba, torch or jax; auto: numba, but torch with device=cuda."""

    device: Device = "auto"
    """Where to compute: auto takes a GPU, when there is one, for torch and jax, else the CPU."""

    def __post_init__(self) -> None:
        check(self, type(self).__plugin__.name)  # type: ignore[attr-defined]

    def warm_up(self) -> None:
        """Import and compile everything that the first view needs, so that the time of no image includes compiling.

        Two small views are paired, and every pass runs over their observations, with colours of 8 bits and with those
        of matched footprints: seconds the first time, then no time.
        """
        from sucre_bench.methods.sucre.passes import opened
        from sucre_bench.methods.sucre.refine_views import Target, corrected_edges, even_deviation
        from sucre_bench.multiview.footprints import matched_footprints
        from sucre_bench.multiview.observe import observe

        n, options = 8, self.pairing_with()
        camera = Camera(np.array([[n, 0, n / 2], [0, n, n / 2], [0, 0, 1.0]]), n, n)
        grey = np.full((n, n, 3), 128 / 255)
        one, same = (View(name, Arrays(grey, np.ones((n, n))), camera, np.eye(4)) for name in ("one", "same"))
        observations = observe(one, [one, same], **options)
        matched_footprints(one, [one, same], observations.pixels, **options)
        even_deviation(observations, np.ones((3, len(observations.pixels)), dtype=np.float32), one.distance)
        water = WaterParameters.of_channels(np.full((3, 3), 0.1))
        corrected_edges(Target(grey, grey, np.ones((n, n))), grey, np.ones_like(grey), water)
        for seen in (observations, replace(observations, colour=observations.colour.astype(np.float32))):
            with opened(seen, self.backend, self.device) as kernel:
                for margin in (None, np.full(3, 0.1)):
                    kernel.system(water, margin)
                kernel.colours(water, np.ones(3), np.zeros((3, 3, 3)))

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return J, NaN where the view has no depth and at specks, the water, and the standard deviation of J.

        info: see `record.restoration`; seconds of each stage besides.
        Raises NotApplicableError when no pixel has depth or none is seen twice, SolveError when the fit fails,
        InputError for a water that cannot be read.
        """
        from sucre_bench.methods.sucre.choose import nearer_encoding
        from sucre_bench.methods.sucre.record import named

        observations = self.observe(scene, view)
        started = time.perf_counter()
        with named(view):
            matched = self.matched(scene, view, observations)
            if self.encoding != "auto":
                return self._restored(scene, view, observations, matched, started)
            nearer = nearer_encoding(self, scene, view, observations, matched)
            chosen = replace(self, encoding=nearer.encoding)
            if nearer.encoding == "linear":
                paused = time.perf_counter()
                observations = chosen.observe(scene, view)
                started += time.perf_counter() - paused  # pairing is no part of the fit
                matched = chosen.matched(scene, view, observations)
            restored = chosen._restored(scene, view, observations, matched, started)  # noqa: SLF001
        return replace(restored, info={**restored.info, "encoding": asdict(nearer)})

    def _restored(
        self, scene: Scene, view: View, observations: Observations, matched: Observations | None, started: float
    ) -> Restoration:
        """Return the restoration in a chosen encoding; matched: see `matched`; started: when its fit began, seconds."""
        from sucre_bench.methods.sucre.record import restoration, with_residuals
        from sucre_bench.methods.sucre.refine_views import fill_pixels_without_depth

        stages = {"read": observations.read_s, "pair": observations.pair_s}
        observations, solution = self._solve(scene, view, observations, matched)
        if solution.light is not None:
            view = self.in_even_light(view, solution.light)
        solution = self._with_limit_of_veil(observations, solution)
        solution = with_residuals(observations, solution)
        if self.colours == "single_view":
            observations, solution = self._single_view(view, solution)
        else:
            solution = self._refined(view, observations, solution)
        solution = self._without_specks(view, solution)
        solution, prior, black = self._with_prior(view, solution)
        if self._decodes(view):  # the curve continues below 0 and above 1
            J = srgb_encode(solution.J)
            deviation = np.abs(srgb_encode(solution.J + solution.deviation) - J)
            solution = replace(solution, J=J, deviation=deviation)
        stages["solve"] = time.perf_counter() - started
        restored = restoration(view, observations, solution, stages, self, self._fitted(view))
        if self.fill:
            restored = fill_pixels_without_depth(restored, view, prior, black)
        if black is not None and restored.water is not None:  # the water tells no veil
            unknown = np.full(3, np.nan)
            restored = replace(restored, water=replace(restored.water, veiling_light=unknown, backscatter=unknown))
        return restored

    def _with_limit_of_veil(self, observations: Observations, solution: Solution) -> Solution:
        """Return the solution, with a limit that names the unknown veil if it would stay visible in the picture.

        Some displays subtract an offset of each channel. They remove such a veil, and no limit is needed.
        """
        from sucre_bench.methods.sucre.own_water import UNKNOWN_VEIL, has_unknown_veil, is_in_air

        is_shown = not (solution.is_under_strobe or normalisation(display_of(self)).removes_offsets)
        if is_shown and has_unknown_veil(solution) and not is_in_air(observations, solution):
            return solution.with_limits([UNKNOWN_VEIL])
        return solution

    def _without_specks(self, view: View, solution: Solution) -> Solution:
        """Return the solution with colours unknown that no surface has: NaN, or for the prior of refine=true to guess.

        robust=false leaves them as least squares has them.
        """
        if solution.is_photograph or not self.robust:
            return solution
        is_speck = specks_of(solution.J, solution.deviation, linear=self._fitted(view) == "linear")
        if self.refine:
            return replace(solution, deviation=np.where(is_speck, np.float32(np.inf), solution.deviation))
        J, deviation = (np.where(is_speck, np.float32(np.nan), values) for values in (solution.J, solution.deviation))
        return replace(solution, J=J, deviation=deviation)

    def _with_prior(self, view: View, solution: Solution) -> tuple[Solution, ImagePrior | None, Array | None]:
        """Return the solution with less noise in its colours (refine=true), the prior, and the black (3,) subtracted.

        The prior keeps brightness. So under a strobe, whose veil is an offset, a black is subtracted first.
        """
        from sucre_bench.methods.sucre.own_water import has_unknown_veil, without_darkest

        black = prior = None
        if self.refine and solution.is_under_strobe and (solution.is_photograph or has_unknown_veil(solution)):
            solution, black = without_darkest(solution)
        if self.refine and not solution.is_photograph:
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
        if solution.is_photograph or (solution.weight is None and not self.refine):
            return solution
        from sucre_bench.methods.sucre.refine_noise import calibrated, followed
        from sucre_bench.methods.sucre.refine_views import (
            Target,
            corrected_edges,
            even_deviation,
            evened,
            wrong_in_target,
        )

        solution = calibrated(observations, solution, decoded=self._decodes(view))
        if not self.refine:
            return solution
        is_wrong = None
        if solution.weight is not None:
            is_wrong = wrong_in_target(observations, solution.weight, view.name)
            observations = replace(observations, weight=solution.weight)
        J, deviation = evened(observations, solution.J, solution.water, view.name), solution.deviation
        if self.robust is not True:
            intensity = self.intensities(view).reshape(*observations.shape, 3)
            target = Target(intensity, view.rgb, view.distance, is_wrong)
            images = corrected_edges(target, observations.image(J), observations.image(deviation), solution.water)
            J, deviation = (image.reshape(-1, 3)[observations.pixels].T for image in images)
        deviation = even_deviation(observations, deviation, view.distance)
        images = followed(observations.image(J), observations.image(deviation))
        J, deviation = (image.reshape(-1, 3)[observations.pixels].T for image in images)
        return replace(solution, J=J, deviation=deviation)

    def matched(self, scene: Scene, view: View, observations: Observations) -> Observations | None:
        """Return the sample with equal footprints that water, encoding and light are found on; None if none is."""
        from sucre_bench.methods.sucre.solution import matched_sample

        is_used = self.footprint or self.encoding == "auto" or self.light not in (AUTO, EVEN)
        if self.water != "own" or not is_used:
            return None
        return matched_sample(self, scene, view, observations)

    def observe(self, scene: Scene, view: View, *, with_view: bool = False, with_ray: bool = False) -> Observations:
        """Return the observations of a view; with their views and rays in any case, if asked for."""
        from sucre_bench.multiview.stored_pairs import paired

        return paired(scene, view, **self.pairing_with(with_view=with_view, with_ray=with_ray))

    def pairing_with(self, *, with_view: bool = False, with_ray: bool = False) -> Options:
        """Return the options of pairing."""
        return {
            "rule": self.pairing,
            "encoding": "linear" if self.encoding == "linear" else "view",
            "with_ray": with_ray,
            "with_view": with_view or self.refine,
        }

    def _solve(
        self, scene: Scene, view: View, observations: Observations, matched: Observations | None
    ) -> tuple[Observations, Solution]:
        """Return the solution, and the observations that it explains."""
        from sucre_bench.methods.sucre.own_water import OwnWater
        from sucre_bench.methods.sucre.solution import colours_for_water

        where = (self.backend, self.device)
        if self.water == "own":
            return OwnWater(self, scene, view).solve(observations, matched)
        if self.water == "shared":
            shared = shared_water(scene, self)
            return observations, colours_for_water(observations, shared.water, shared.uncertainty, *where)
        known = water_of(self.water, scene, view, self._fitted(view))
        if not known.gains:
            return observations, colours_for_water(observations, known.water, None, *where)
        light = Light.of_gains(known.gains, known.water)
        observations = light.removed(self.observe(scene, view, with_view=True, with_ray=True))
        solution = colours_for_water(observations, known.water, None, *where)
        return observations, replace(solution, about=solution.about | {"gains": dict(known.gains)})

    @property
    def compute(self) -> dict[str, Any]:
        """Options that every fit has."""
        return {"backend": self.backend, "device": self.device}

    def _single_view(self, view: View, solution: Solution) -> tuple[Observations, Solution]:
        """Return the image's own observations, and their colours in the water of a solution."""
        from sucre_bench.methods.sucre.solution import colours_for_water
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

    def in_even_light(self, view: View, light: Light) -> View:
        """Return the view as even light would show it. May exceed 1; a strobe needs depth, else NaN."""
        assert view.camera is not None
        rays = np.moveaxis(pixel_rays(view.camera), -1, 0)[:2]
        z = np.where(view.depth > 0, view.distance, np.nan if light.parts.strobe else 1.0).astype(np.float64)
        even = replace(light, gains=np.zeros((1, 3)))
        recorded = np.moveaxis(self.intensities(view).reshape(view.rgb.shape), -1, 0)
        linear = np.moveaxis(even.evened(recorded, rays, z, 0)[0], 0, -1)
        rgb = srgb_encode(linear) if self._decodes(view) else linear
        return replace(view, pixels=Arrays(rgb.astype(np.float32), view.depth, view.reference))

    def _fitted(self, view: View) -> Encoding:
        """The encoding of the intensities that are fitted."""
        return "linear" if self.encoding == "linear" else view.encoding

    def _decodes(self, view: View) -> bool:
        return self._fitted(view) != view.encoding


@method(
    needs={"depth", "poses"},
    requires=("numba",),
    may_use=("jax", "torch"),
    display="black-0.5-white-99",
    cites=_AFTER,
    reads=("water",),
)
@dataclass(frozen=True)
class SucrePlus(Sucre):
    """This project's method on SUCRe's model, for pictures: like `sucre`, with colours above zero and less noise.

    Dots are removed, edges follow the image, and all channels have one black. SUCRe's authors have not seen it. Pixels
    without depth have no colour, unless fill=true guesses them.

    The veil can absorb an offset of all colours without changing any residual, so an offset is the least known quantity
    of the model. A black of each channel would make up for it by turning hues; one black for all channels cannot. White
    is a gain of each channel.
    """

    physical: bool = True
    refine: bool = True


def typed(options: Any, name: str, value: bool | str) -> str:
    """Return an option as a user types it, "method.physical=true".

    It is empty where it would change nothing, or does not go with the other options.
    """
    try:
        is_new = replace(options, **{name: value}) != options
    except InputError:
        return ""
    if not is_new or (name == "physical" and options.water not in ("own", "shared")):
        return ""
    return f"method.{name}={str(value).lower()}"


def check(options: Any, method: str) -> None:
    """Raise InputError for values that are no choice, and for options that do not go together; method: its name.

    With another water than own there is nothing to weigh. physical may stay, with an effect for water=shared.
    """
    water = f"{method}.water={options.water}"
    if options.solver != "exact":
        raise InputError(f"{method}.solver: '{options.solver}' is not a choice; use exact, or the method sucre_paper")
    check_source(options.water)
    if options.robust != "auto" and not isinstance(options.robust, bool):
        raise InputError(f"{method}.robust: '{options.robust}' is not a choice; use true, false or auto")
    parts = parts_of(options.light, f"{method}.light")
    if options.one_coefficient and options.water not in ("own", "shared"):
        raise InputError(f"{water}: has both coefficients; give {method}.one_coefficient=false")
    extras = {"robust": options.robust is True, "light": parts not in (None, Parts())}
    if options.water != "own" and any(extras.values()):
        name = next(name for name, is_set in extras.items() if is_set)
        raise InputError(f"{method}.{name}: is found with the image's own water; leave out {water}")
    if parts is not None and parts.strobe and options.one_coefficient:
        raise InputError(f"{method}.light: the veil of a strobe is not eq. 1; give {method}.one_coefficient=false")
    if parts is not None and parts.strobe and (options.fill or options.colours == "single_view"):
        name = "fill" if options.fill else "colours"
        raise InputError(
            f"{method}.{name}: a strobe's light on pixels without depth is not known; use {method}.light=auto"
        )
    for name, value in (("backend", "torch"), ("backend", "jax"), ("device", "cuda")):
        if getattr(options, name) == value:
            library = "jax" if options.backend == "jax" else "torch"
            require(f"{method}.{name}={value}", library)
