"""SUCRe: colour restoration from several views of a scene (Boittiaux et al., 3DV 2024).

Pairing finds every pixel of the target in the other views, at other distances; the fit explains all observations by
one water and one colour a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from sucre_bench import InputError, Restoration, Scene, SolveError, View, Water, method

# The paper's start: J = I and B = beta = gamma = 0.1.
_INITIAL_WATER = np.full((3, 3), 0.1)

# Adam's own default (Kingma & Ba 2015), which the paper does not change.
_EPS = 1e-8


@method(
    needs={"depth", "poses"},
    requires=("torch",),
    display="stretch-1-99",
    cites="Boittiaux, Marxer, Dune, Arnaubec, Ferrera & Hugel 2024, SUCRe: Leveraging Scene Structure for Underwater "
    "Color Restoration, 3DV",
)
@dataclass(frozen=True)
class SucrePaper:
    """SUCRe with the paper's own settings: mutual pairing, then 200 steps of Adam from B = beta = gamma = 0.1.

    The sum of squares over all observations of all pixels with depth is lowered without bounds and the last iterate
    is kept, converged or not. A pixel that no other view shows has its own observation alone: it says nothing about
    the water, and yet takes part, as in the paper.
    """

    steps: int = 200
    """Steps of Adam, each over all observations."""

    lr: float = 0.05
    """Adam's learning rate, for intensities as for B, beta and gamma."""

    objective: Literal["sum", "mean"] = "sum"
    """The sum of squares of the paper's eq. 7, or that sum divided by 3 N as in the authors' program: the minimum is
    the same, but Adam's eps then holds the colours back, noticeably from some 1e6 observations on."""

    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where to compute: auto takes a CUDA GPU when PyTorch sees one."""

    def __post_init__(self) -> None:
        if self.steps < 1 or not self.lr > 0:
            raise InputError(f"sucre_paper: steps={self.steps}, lr={self.lr}; both must be positive")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return J, NaN where the view has no depth, and the water.

        info: cost and initial_cost, sums of squares of each channel; negative_share of J in each channel, which is
        not physical; steps, n_observations, n_views, device.
        Raises SolveError when no pixel has depth, or when Adam left the range of numbers.
        """
        from sucre_bench.methods.sucre.adam import minimise
        from sucre_bench.multiview.observe import observe

        device = self._device()
        observations = observe(view, scene.views)
        own = view.rgb.reshape(-1, 3)[observations.pixels].T
        eps = _EPS if self.objective == "sum" else _EPS * 3 * len(observations)  # the same as dividing the sum
        fit = minimise(observations, own, _INITIAL_WATER, steps=self.steps, lr=self.lr, eps=eps, device=device)
        if not np.isfinite(fit.cost).all():
            raise SolveError(f"{view.name}: Adam diverged after {self.steps} steps; lower lr ({self.lr}) or steps")
        return Restoration(
            observations.image(fit.J),
            water=Water(*fit.water),
            info={
                "cost": fit.cost.tolist(),
                "initial_cost": fit.initial_cost.tolist(),
                "negative_share": (fit.J < 0).mean(axis=1).tolist(),
                "steps": self.steps,
                "n_observations": len(observations),
                "n_views": len(observations.views),
                "unreadable": observations.unreadable,
                "device": device,
            },
        )

    def _device(self) -> str:
        import torch

        if self.device == "cuda" and not torch.cuda.is_available():
            raise InputError("sucre_paper.device: PyTorch sees no CUDA GPU; use device=auto or device=cpu")
        if self.device == "auto":
            return "cuda" if torch.cuda.is_available() else "cpu"
        return self.device
