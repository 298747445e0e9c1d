"""The method `sucre_paper`: SUCRe as published, with the pairing, starting point and optimiser of the paper."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sucre_bench import InputError, Restoration, Scene, SolveError, View, method
from sucre_bench.arrays import Array
from sucre_bench.imaging.fill import FillOption
from sucre_bench.machine.compute import Device
from sucre_bench.machine.provenance import absent, gpu, require
from sucre_bench.methods.sucre.adam import EPS, Steps, descend
from sucre_bench.methods.sucre.known_water import START, check_source, water_of
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.passes import backend_for, opened
from sucre_bench.methods.sucre.solution import Course, Solution
from sucre_bench.methods.sucre.uncertainty import uncertainty_of
from sucre_bench.multiview.observations import Observations

CITES = (
    "Boittiaux, Marxer, Dune, Arnaubec, Ferrera & Hugel 2024, SUCRe: Leveraging Scene Structure for Underwater "
    "Color Restoration, 3DV"
)

# The start beside J = I.
INITIAL_WATER = WaterParameters.of_channels(np.full((3, 3), 0.1))


@method(
    needs={"depth", "poses"},
    requires=("numba",),
    may_use=("torch",),
    display="stretch-1-99",
    cites=CITES,
    reads=("start",),
)
@dataclass(frozen=True)
class SucrePaper(FillOption):
    """SUCRe with the paper's own settings: mutual pairing, then 200 steps of Adam from B = beta = gamma = 0.1.

    Adam lowers the sum of squares over all observations of all pixels with depth, without bounds. The last iterate is
    kept, converged or not. A pixel that no other view shows has one observation. It says nothing about the water and
    takes part all the same, as in the paper.
    """

    steps: int = 200
    """Steps of Adam, each over all observations."""

    lr: float = 0.05
    """Adam's learning rate, for intensities as for B, beta and gamma."""

    objective: Literal["sum", "mean"] = "sum"
    """sum: the sum of squares of the paper's eq. 7; mean: that sum divided by 3 N, as in the authors' program. The
    minimum is the same, but with the mean Adam's eps slows the colours down, noticeably from some 1e6 observations
    on."""

    start: Literal["paper", "truth"] | str = "paper"
    """The water that Adam starts from. paper: B = beta = gamma = 0.1; METHOD: what it estimates on each image, such as
    seathru; or a file or folder, as for water= of `sucre`; truth: the dataset's. Colours start at the image's."""

    one_coefficient: bool = False
    """Fit the paper's eq. 1, in which backscatter has the coefficient of attenuation: gamma = beta."""

    device: Device = "auto"
    """Where to compute: auto takes a CUDA GPU when PyTorch sees one. The CPU uses compiled loops."""

    def __post_init__(self) -> None:
        check_source(self.start, START)
        if self.steps < 1 or not self.lr > 0:
            raise InputError(
                f"method.steps is {self.steps}, method.lr {self.lr}; both must be positive"
            )
        if self.device == "cuda":
            require("method.device=cuda", "torch")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return J, NaN where the view has no depth, the water, and the standard deviation of J.

        info: as of `sucre`; and initial_cost, the sum of squares of each channel before the first step.
        Raises NotApplicableError when no pixel has depth, SolveError when Adam left the range of numbers, InputError
        for a start that cannot be read.
        """
        from sucre_bench.methods.sucre.record import named, restoration, with_residuals
        from sucre_bench.methods.sucre.refine_views import fill_pixels_without_depth
        from sucre_bench.multiview.stored_pairs import paired

        observations = paired(scene, view)  # by eqs. 4 and 5, the rule "mutual"
        started = time.perf_counter()
        start = start_of(observations, view.rgb.reshape(-1, 3))
        water = INITIAL_WATER
        if self.start != "paper":
            water = water_of(self.start, scene, view, view.encoding, START).water
        with named(view):
            solution = solve_adam(observations, start, self, water)
        solution = with_residuals(observations, solution)
        solve_s = time.perf_counter() - started
        stages = {"read": observations.read_s, "pair": observations.pair_s, "solve": solve_s}
        restored = restoration(observations, solution, stages, self)
        return fill_pixels_without_depth(restored, view) if self.fill else restored


def start_of(observations: Observations, intensities: Array) -> Array:
    """Return the paper's start J = I (3, P): the target's intensities (H W, 3), or another view's where not finite."""
    own = intensities[observations.pixels].swapaxes(0, 1)
    return np.where(
        np.isfinite(own), own, observations.intensity(slice(0, len(observations.pixels)))
    )


def solve_adam(
    observations: Observations,
    start: Array,
    options: SucrePaper,
    water: WaterParameters = INITIAL_WATER,
) -> Solution:
    """Take Adam's steps from J = start (3, P) and a water, full batch, without bounds, and return its last iterate.

    Raises SolveError when it diverges.
    """
    place = _device_for(options.device)
    # the same as dividing the sum
    eps = EPS if options.objective == "sum" else EPS * 3 * len(observations)
    tied = options.one_coefficient
    rows = water.by_channel()[:, [0, 1, 1 if tied else 2]]
    found = descend(
        observations, start, rows, Steps(options.steps, options.lr, eps, tied), place
    )
    if not np.isfinite(found.cost).all():
        raise SolveError(
            f"Adam diverged after {options.steps} steps; lower lr ({options.lr}) or steps"
        )
    water = WaterParameters.of_channels(found.water)
    with opened(observations, "torch" if place == "cuda" else "numba", place) as kernel:
        uncertainty = uncertainty_of(
            water, kernel.system(water), None, observations.n_excess, tied=tied
        )
        _, deviation = kernel.colours(water, uncertainty.noise, uncertainty.covariance)
    course = Course(solver="adam", device=place, steps=options.steps, initial_cost=found.first)
    return Solution(found.J, deviation, water, found.cost, uncertainty, course)


def _device_for(device: Device) -> Literal["cpu", "cuda"]:
    """Return where to compute. PyTorch is imported only where there is a GPU: it takes seconds."""
    if device == "cpu" or (device == "auto" and (absent("torch") or gpu() is None)):
        return "cpu"
    return backend_for("torch", device)[1]
