"""SUCRe as published: the method `sucre_paper`, with the pairing, starting point and optimiser of the paper."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Literal

from sucre_bench import InputError, Restoration, Scene, View, method
from sucre_bench.imaging.fill import FillOption
from sucre_bench.machine.compute import Device

CITES = (
    "Boittiaux, Marxer, Dune, Arnaubec, Ferrera & Hugel 2024, SUCRe: Leveraging Scene Structure for Underwater "
    "Color Restoration, 3DV"
)


@method(needs={"depth", "poses"}, requires=("torch",), display="stretch-1-99", cites=CITES)
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

    device: Device = "auto"
    """Where to compute: auto takes a CUDA GPU when PyTorch sees one."""

    residuals: bool = False
    """Write residual statistics of the fit, and some points over distance, to <view>.json, for figures."""

    def __post_init__(self) -> None:
        if self.steps < 1 or not self.lr > 0:
            raise InputError(f"sucre_paper: steps is {self.steps}, lr {self.lr}; both must be positive")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return J, NaN where the view has no depth, the water, and the standard deviation of J.

        info: as of `sucre`; and initial_cost, the sum of squares of each channel before the first step.
        Raises NotApplicableError when no pixel has depth, SolveError when Adam left the range of numbers.
        """
        from sucre_bench.methods.sucre.fill_without_depth import fill_pixels_without_depth
        from sucre_bench.methods.sucre.solvers import solve_adam, start_of
        from sucre_bench.methods.sucre.to_restoration import named, restoration, with_residuals
        from sucre_bench.multiview.stored_pairs import paired

        observations = paired(scene, view)
        started = time.perf_counter()
        start = start_of(observations, view.rgb.reshape(-1, 3))
        with named(view):
            solution = solve_adam(observations, start, self.steps, self.lr, self.objective, "torch", self.device)
        solve_s = time.perf_counter() - started
        if self.residuals:
            solution = with_residuals(observations, solution)
        stages = {"read": observations.read_s, "pair": observations.pair_s, "solve": solve_s}
        restored = restoration(view, observations, solution, stages, self)
        return fill_pixels_without_depth(restored, view) if self.fill else restored
