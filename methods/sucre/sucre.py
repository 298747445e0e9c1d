"""SUCRe, solved exactly, with everything about it open to choice."""

from __future__ import annotations

import functools
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sucre_bench import InputError, Restoration, Scene, SolveError, View, method
from sucre_bench.arrays import Array
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.machine.cores import Device
from sucre_bench.machine.progress import say
from sucre_bench.methods.sucre.given import check_source, water_by, water_of
from sucre_bench.methods.sucre.kernels import Backend
from sucre_bench.methods.sucre.paper import CITES
from sucre_bench.methods.sucre.prior import posterior
from sucre_bench.scene import Encoding

if TYPE_CHECKING:
    from sucre_bench.methods.sucre.exact import WaterFit
    from sucre_bench.methods.sucre.solvers import Solution
    from sucre_bench.multiview.observations import Observations
    from sucre_bench.multiview.observe import Options

__all__ = ["Sucre"]


@method(
    needs={"depth", "poses"},
    requires=("numba", "torch"),
    display="stretch-1-99",
    cites=CITES,
    reads=("water", "water_from"),
)
@dataclass(frozen=True)
class Sucre:
    """SUCRe at its exact minimum: one water for all observations, one colour a pixel, no step count.

    The paper's model and least squares; colours are eliminated, and the water is found by Levenberg-Marquardt from
    several starts. Attenuation and backscatter are held positive, the veiling light between 0 and 1.
    """

    solver: Literal["exact", "adam", "adam_closed_form"] = "exact"
    """exact: the minimum; adam: the paper's steps on all unknowns; adam_closed_form: the paper's steps on the water,
    with the best colours at each."""

    physical: bool = False
    """Hold colours above zero, up to noise: a veil brighter than the darkest pixels costs (solver=exact)."""

    prior: bool = False
    """Draw colours that are mostly noise towards the image's mean colour, as far as their noise says."""

    pairing: Literal["mutual", "depth"] = "mutual"
    """mutual: the paper's, pixels that project onto one another; depth: points whose depths agree, colours
    interpolated, more observations where views differ in scale."""

    tolerance: float = 0.03
    """By how much depths may differ with pairing=depth, relative."""

    encoding: Literal["view", "linear"] = "view"
    """Fit intensities as stored, as the paper does, or decoded to linear light (sRGB)."""

    water: Literal["own", "shared", "truth"] | str = "own"
    """own: fitted to each image; shared: to many images of the scene at once; truth; a .json or .npz file with B,
    beta and gamma; or a folder of them, one a view, as restored/ of an earlier run."""

    water_from: str = ""
    """A method that estimates the water of each image, in place of the fit: its name; it has its default options."""

    colours: Literal["multi_view", "single_view"] = "multi_view"
    """multi_view: each colour from all its observations; single_view: from the image's own intensity alone, in the same
    water, which tells what either brings."""

    shared_views: int = 40
    """How many images water=shared is fitted to at most, spread evenly over the scene."""

    robust: bool = False
    """Give less weight to observations that do not fit: animals that move, pixels paired wrongly (solver=exact)."""

    lamp: bool = False
    """Fit a lamp that is fixed to the camera and is the only light (solver=exact), as in the deep sea."""

    steps: int = 200
    """Steps of Adam."""

    lr: float = 0.05
    """Adam's learning rate."""

    backend: Backend = "auto"
    """What computes: numba, torch, jax, or numpy in float64; auto: torch on a GPU, else numba."""

    device: Device = "auto"
    """Where to compute: auto takes a GPU when there is one."""

    pairs: Path | None = None
    """Folder that keeps observations on disk, for less memory and for the next run; None keeps them nowhere."""

    seed: int = 0
    """Seed of the sample of pixels that the fit starts on."""

    residuals: bool = False
    """Keep what the fit leaves unexplained, and some points over distance, for figures of it (in <view>.json)."""

    def __post_init__(self) -> None:
        own = getattr(type(self), "__plugin__").name  # noqa: B009, a decorator sets it
        for name in ("tolerance", "shared_views", "steps", "lr"):
            if not getattr(self, name) > 0:
                raise InputError(f"{own}.{name}: {getattr(self, name)} must be positive")
        if self.tolerance >= 1:
            raise InputError(f"{own}.tolerance: {self.tolerance} must be below 1, it is a share of the depth")
        if self.seed < 0:
            raise InputError(f"{own}.seed: {self.seed} must not be negative")
        extras = [name for name in ("physical", "robust", "lamp") if getattr(self, name)]
        if extras and self.solver != "exact":
            fault = f"goes with solver=exact, not with solver={self.solver}"
            raise InputError(f"{own}.{extras[0]}: {fault}; give method.{extras[0]}=false")
        given = [f"{name}={getattr(self, name)}" for name in ("water", "water_from") if getattr(self, name)]
        given = [each for each in given if each != "water=own"]
        if len(given) > 1:
            raise InputError(f"{own}.water_from: the water is given twice, {' and '.join(given)}; leave one out")
        if given and self.solver != "exact":
            raise InputError(f"{own}.{given[0]}: leaves nothing to solver={self.solver}; leave one out")
        if not self.water:
            raise InputError(f"{own}.water: is empty; use own, shared, truth, a file or a folder")
        if self.water_from:
            check_source(self.water_from)
        fitted = [name for name in ("robust", "lamp") if getattr(self, name)]
        if given and fitted:
            raise InputError(f"{own}.{fitted[0]}: is found with the image's own water; leave out {given[0]}")
        if self.lamp and self.colours == "single_view":
            raise InputError(f"{own}.lamp: is found with colours of all views; leave out colours=single_view")

    def warm_up(self) -> None:
        """Compile what the first view would have to wait for."""
        from sucre_bench.methods.sucre.warm_up import compile_for

        compile_for(self.backend, self.device, self._pairing)

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return J, NaN where the view has no depth, the water, and the standard deviation of J.

        info: see `outcome.restoration`; seconds of each stage besides.
        Raises NotApplicableError when no pixel has depth or none is seen twice, SolveError when the fit fails,
        InputError for a water that cannot be read.
        """
        from sucre_bench.methods.sucre.outcome import named, restoration, with_residuals

        observations = self._observe(scene, view)
        stages = {"read": observations.read_s, "pair": observations.pair_s}
        started = time.perf_counter()
        with named(view):
            observations, solution = self._solve(scene, view, observations)
            if self.residuals:
                solution = with_residuals(observations, solution, self.seed)
            if self.colours == "single_view":
                observations, solution = self._alone(view, solution)
        if self.prior:
            J, deviation = posterior(solution.J, solution.deviation)
            solution = replace(solution, J=J, deviation=deviation)
        if self._decodes(view):
            solution = _encoded(solution)
        stages["solve"] = time.perf_counter() - started
        return restoration(view, observations, solution, stages, self._fitted(view))

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
        }

    def _solve(self, scene: Scene, view: View, observations: Observations) -> tuple[Observations, Solution]:
        """The solution, and the observations that it is of: a lamp leaves some out."""
        if self.lamp:
            observations, about = self._without_lamp(observations)
            solution = self._exact(observations)
            return observations, replace(solution, about=solution.about | about)
        return observations, self._solve_plainly(scene, view, observations)

    def _solve_plainly(self, scene: Scene, view: View, observations: Observations) -> Solution:
        from sucre_bench.methods.sucre import solvers

        where = (self.backend, self.device)
        if self.solver == "adam":
            own = solvers.start_of(observations, self._own(view))
            return solvers.solve_adam(observations, own, self.steps, self.lr, "sum", *where)
        if self.solver == "adam_closed_form":
            return solvers.solve_adam_closed_form(observations, self.steps, self.lr, *where)
        if self.water == "shared":
            shared = _shared_fit(scene, self)
            if isinstance(shared, SolveError):
                raise shared
            return solvers.colours_in(observations, shared.water, shared.trust, *where)
        if self.water_from:
            water = water_by(self.water_from, scene, view, self._fitted(view))
            return solvers.colours_in(observations, water, None, *where)
        if self.water != "own":
            return solvers.colours_in(observations, water_of(self.water, scene, view, self._fitted(view)), None, *where)
        return self._exact(observations)

    def _alone(self, view: View, solution: Solution) -> tuple[Observations, Solution]:
        """The image's own intensities, and their colours in the water of a solution."""
        from sucre_bench.methods.sucre.solvers import colours_in
        from sucre_bench.multiview.observe import observe

        own = observe(view, [view], **self._pairing)
        alone = colours_in(own, solution.water, solution.trust, self.backend, self.device)
        return own, replace(alone, about=solution.about)

    def _exact(self, observations: Observations) -> Solution:
        from sucre_bench.methods.sucre.solvers import solve_exact

        return solve_exact(
            observations,
            physical=self.physical,
            robust=self.robust,
            backend=self.backend,
            device=self.device,
            seed=self.seed,
        )

    def _without_lamp(self, observations: Observations) -> tuple[Observations, dict[str, Any]]:
        """The observations as they would be in even light, where a lamp explains them better, and that lamp."""
        from sucre_bench.methods.sucre.exact import fit
        from sucre_bench.methods.sucre.lamp import estimate, lit

        without = fit(observations, backend=self.backend, device=self.device, seed=self.seed)
        found = estimate(observations, without.water.T, seed=self.seed)
        about = {"noise": found.noise, "noise_without": found.noise_without}
        if not found.is_worth_it:
            say("no lamp: the observations are explained as well without one")
            return observations, {"lamp": about | {"found": False}}
        lamp = {"lamp_from_cam": found.lamp.lamp_from_cam.tolist(), "precision": found.lamp.precision.tolist()}
        observations = lit(observations, found.lamp)
        if not observations.n_repeated:
            raise SolveError("the lamp that was found leaves no pixel that two views show brightly; use lamp=false")
        return observations, {"lamp": about | {"found": True} | lamp}

    def _own(self, view: View) -> Array:
        """The target's intensities (H W, 3), as the fit sees them."""
        rgb = view.rgb.reshape(-1, 3)
        return srgb_decode(rgb) if self._decodes(view) else rgb

    def _fitted(self, view: View) -> Encoding:
        """The encoding of the intensities that are fitted."""
        return "linear" if self.encoding == "linear" else view.encoding

    def _decodes(self, view: View) -> bool:
        return self._fitted(view) != view.encoding


def _encoded(solution: Solution) -> Solution:
    """The colours of a fit to linear light, encoded as the view is; below 0 and above 1 the curve goes on."""
    J = srgb_encode(solution.J)
    return replace(solution, J=J, deviation=np.abs(srgb_encode(solution.J + solution.deviation) - J))


@functools.lru_cache(maxsize=4)  # every view of the scene asks for it
def _shared_fit(scene: Scene, sucre: Sucre) -> WaterFit | SolveError:
    """The common water; or why there is none, which is kept too, since finding out takes as long."""
    try:
        return _fit_shared(scene, sucre)
    except SolveError as fault:
        return fault


def _fit_shared(scene: Scene, sucre: Sucre) -> WaterFit:
    from sucre_bench.methods.sucre.exact import fit
    from sucre_bench.methods.sucre.shared import samples

    targets = samples(
        scene,
        lambda view: sucre._observe(scene, view),
        most=sucre.shared_views,
        singles=sucre.physical,
        seed=sucre.seed,
    )
    return fit(
        targets,
        physical=sucre.physical,
        backend=sucre.backend,
        device=sucre.device,
        seed=sucre.seed,
    )
