"""The methods `sucre` and `sucre_plus`: this project's fit of SUCRe's model, its options, and how they go together."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sucre_bench import Arrays, InputError, Restoration, Scene, View, method
from sucre_bench.camera import centred_camera
from sucre_bench.imaging.encoding import srgb_encode
from sucre_bench.imaging.fill import FillOption
from sucre_bench.machine.compute import Device
from sucre_bench.machine.provenance import require
from sucre_bench.methods.sucre.known_water import check_source
from sucre_bench.methods.sucre.light import Light, Parts, Problem, Sample, parts_of
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.passes import Backend

if TYPE_CHECKING:
    from sucre_bench.multiview.observations import Observations
    from sucre_bench.multiview.observe import Options

_AFTER = "by this project, after Boittiaux et al. 2024; its authors have not seen it"


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
    """This project's method on SUCRe's model, to measure the water: one water for a view or a dive, one colour a pixel.

    `sucre_paper` is SUCRe as published; its authors have not seen this method. The model and its least squares are the
    paper's. Colours are eliminated, and Newton's method finds the water from several starts. Attenuation and
    backscatter stay positive, the veiling light between 0 and 1. Footprints of observations, exposure, uneven light and
    weak priors are this project's.
    """

    footprint: bool | Literal["auto"] = "auto"
    """true: fit the water to observations that average the same ground as the farthest view; false: to single pixels,
    which makes attenuation too high where poses and depth are right; auto: what predicts views that the fit has not
    seen. Colours stay sharp. Needs water=own or shared."""

    physical: bool | Literal["auto"] = "auto"
    """true: keep colours above zero, up to noise; a veil brighter than the darkest pixels raises the cost; auto: as
    footprint=auto."""

    robust: bool | Literal["auto"] = "auto"
    """true: give less weight to observations that do not fit, such as animals that move and pixels paired wrongly;
    auto: as footprint=auto; false: never. A colour that is too bright for a surface stays unknown, except with false;
    refine=true guesses it."""

    light: str = "auto"
    """What differs in the light of the views, fitted with the water: exposure (a gain for each view),
    white_balance (three), lens (vignetting), or some joined by +; even: nothing; auto: as footprint=auto."""

    encoding: Literal["view", "linear"] = "view"
    """view: fit intensities as stored, as the paper does; linear: fit linear light, decoded from sRGB."""

    water: Literal["own", "shared", "truth"] | str = "own"
    """own: fit each image; those that do not determine a water take that of the judged dive; shared: fit many images of
    the scene together; truth: the dataset's true water; METHOD: the water that another method estimates on each image
    with its default options; a .json or .npz file with B, beta and gamma; or a folder with one such file for each view,
    like restored/ of an earlier run."""

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
        check(self)

    @property
    def sees_whole_scene(self) -> bool:
        """Whether all views of a scene rest on one water, which one worker fits once."""
        return self.water == "shared"

    def warm_up(self) -> None:
        """Import and compile everything that the first view needs, so that the time of no image includes compiling.

        Two small views are paired, every pass runs over their observations, with colours of 8 bits and with those of
        matched footprints, and light is fitted: seconds the first time, then no time.
        """
        from sucre_bench.methods.sucre.observed import Observed
        from sucre_bench.methods.sucre.passes import opened

        n = 8
        camera = centred_camera(n, n, n)
        grey = np.full((n, n, 3), 128 / 255)
        one, same = (
            View(name, Arrays(grey, np.ones((n, n))), camera, np.eye(4))
            for name in ("one", "same")
        )
        seen = Observed.of(
            self, Scene("warm up", [one, same], frozenset({"depth", "poses"})), one
        )
        observations = seen.observations
        seen.matched_at(observations.pixels)
        water = WaterParameters.of_channels(np.full((3, 3), 0.1))
        for stored in (
            observations,
            replace(observations, colour=observations.colour.astype(np.float32)),
        ):
            with opened(stored, self.backend, self.device) as kernel:
                for margin in (None, np.full(3, 0.1)):
                    kernel.system(water, margin)
                kernel.colours(water, np.ones(3), np.zeros((3, 3, 3)))
        sample = Sample.of(seen.with_rays().observations, one.name)
        problem = Problem(sample, Parts(1, lens=True))
        problem.descend(problem.unknowns(Light.even(water, sample.views)), tolerance=1.0)

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return J, NaN where the view has no depth and at specks, the water, and the standard deviation of J.

        info: see `record.restoration`; seconds of each stage.
        Raises NotApplicableError when no pixel has depth or none is seen twice, SolveError when the fit fails,
        InputError for a water that cannot be read.
        """
        from sucre_bench.methods.sucre.observed import Observed
        from sucre_bench.methods.sucre.policy import Veil, solved, veil_of
        from sucre_bench.methods.sucre.record import (
            named,
            restoration,
            unknown_veil,
            with_residuals,
        )
        from sucre_bench.methods.sucre.refine_views import fill_pixels_without_depth, refined

        seen = Observed.of(self, scene, view)
        started = time.perf_counter()
        with named(view):
            stages = {"read": seen.observations.read_s, "pair": seen.observations.pair_s}
            seen, solution = solved(seen)
            if veil_of(solution, self) is Veil.SAID:
                solution = solution.with_limits([unknown_veil()])
            solution = with_residuals(seen.observations, solution)
            if self.colours == "single_view":
                seen = seen.alone()
                alone = seen.coloured(solution.water, solution.uncertainty)
                solution = replace(alone, course=solution.course, light=solution.light)
            solution, prior = refined(seen, solution)
            if seen.is_decoded:  # the curve continues below 0 and above 1
                J = srgb_encode(solution.J)
                deviation = np.abs(srgb_encode(solution.J + solution.deviation) - J)
                solution = replace(solution, J=J, deviation=deviation)
            stages["solve"] = time.perf_counter() - started
            restored = restoration(seen.observations, solution, stages, self, seen.encoding)
            return (
                fill_pixels_without_depth(restored, seen.view, prior) if self.fill else restored
            )

    def observe(
        self, scene: Scene, view: View, *, with_view: bool = False, with_ray: bool = False
    ) -> Observations:
        """Return the observations of a view; with their views and rays in any case, if asked for."""
        from sucre_bench.multiview.stored_pairs import paired

        return paired(scene, view, **self.pairing_with(with_view=with_view, with_ray=with_ray))

    def pairing_with(self, *, with_view: bool = False, with_ray: bool = False) -> Options:
        """Return the options of pairing."""
        return {
            "encoding": "linear" if self.encoding == "linear" else "view",
            "with_ray": with_ray,
            "with_view": with_view or self.refine or bool(self.robust),
        }

    @property
    def compute(self) -> dict[str, Any]:
        """Options that every fit has."""
        return {"backend": self.backend, "device": self.device}


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
    """This project's method on SUCRe's model, for pictures: like `sucre`, with less noise.

    Dots are removed, edges follow the image, and all channels have one black. SUCRe's authors have not seen it. Pixels
    without depth have no colour, unless fill=true guesses them.

    The veil can absorb an offset of all colours without changing any residual, so an offset is the least known quantity
    of the model. A black of each channel would make up for it by turning hues; one black for all channels cannot. White
    is a gain of each channel.
    """

    refine: bool = True


def check(options: Any) -> None:
    """Raise InputError for values that are no choice, and for options that do not go together.

    With another water than own there is nothing to weigh. physical may stay, with an effect for water=shared.
    """
    water = f"method.water={options.water}"
    check_source(options.water)
    for name in ("footprint", "physical", "robust"):
        value = getattr(options, name)
        if value != "auto" and not isinstance(value, bool):
            raise InputError(
                f"method.{name}: '{value}' is not a choice; use true, false or auto"
            )
    parts = parts_of(options.light)
    found_with_own = ""
    if options.robust is True:
        found_with_own = "robust"
    elif parts not in (None, Parts()):
        found_with_own = "light"
    if options.water not in ("own", "shared") and found_with_own:
        raise InputError(f"method.{found_with_own}: is found with the water; leave out {water}")
    for name, value in (("backend", "torch"), ("backend", "jax"), ("device", "cuda")):
        if getattr(options, name) == value:
            library = "jax" if options.backend == "jax" else "torch"
            require(f"method.{name}={value}", library)
