"""The method `sucre_paper`: SUCRe as published, with the pairing, starting point and optimiser of the paper.

Adam takes its steps on all unknowns at once (SUCRe, sec. 4, Optimization; Kingma & Ba 2015). Minimised is eq. 7, for
each channel the sum over all observations i of all pixels p

    E = sum r^2,    r = I - J a - b,    a = exp(-beta z),    b = B (1 - exp(-gamma z))

with the gradient in closed form instead of by automatic differentiation over all observations:

    dE/dJ_p = -2 sum_i r a                          (over the observations of pixel p)
    dE/dtheta = -2 sum_p sum_i r D_theta            (theta in B, beta, gamma; D = dI/dtheta, see model.py)

Adam does not depend on the scale of E except through its eps, which is added to the size of a gradient. Minimising
E / (3 N) with eps is therefore minimising E with 3 N eps: at N = 3e6 observations and the usual 1e-8 that is 0.1, as
much as a pixel's own gradient, and colours lag behind the water; at 1e8 it is 3. The sum is safe at any N.

Blocks of pixels are small enough to stay in a processor's cache; float32 inside a block, float64 across.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sucre_bench import InputError, Restoration, Scene, SolveError, View, method
from sucre_bench.arrays import Array
from sucre_bench.imaging.fill import FillOption
from sucre_bench.machine.compute import Device
from sucre_bench.machine.progress import track
from sucre_bench.methods.sucre.known_water import START, check_source, water_of
from sucre_bench.methods.sucre.model import WaterParameters, derivatives
from sucre_bench.methods.sucre.passes import backend_for, one_torch_thread, opened
from sucre_bench.methods.sucre.solution import Course, Solution
from sucre_bench.methods.sucre.uncertainty import uncertainty_of
from sucre_bench.multiview.observations import Observations

if TYPE_CHECKING:
    import torch

CITES = (
    "Boittiaux, Marxer, Dune, Arnaubec, Ferrera & Hugel 2024, SUCRe: Leveraging Scene Structure for Underwater "
    "Color Restoration, 3DV"
)

# The start beside J = I.
_INITIAL_WATER = WaterParameters.of_channels(np.full((3, 3), 0.1))

# Adam's own default (Kingma & Ba 2015), which the paper does not change.
_EPS = 1e-8

# Pixels in a block. CPU: 0.5 MB an array; 200 evaluations of 3.15 M observations on 2 cores took 11.5 s with 2^15,
# where calls dominate, 8.2 s with 2^16, 8.5 s with 2^17, 9.3 s with 2^18; larger ones suffer less on a busy machine.
# GPU: launches dominate until a block fills the device.
_BLOCK_PX = {"cpu": 1 << 17, "cuda": 1 << 22}


@method(
    needs={"depth", "poses"},
    requires=("torch",),
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
    """Where to compute: auto takes a CUDA GPU when PyTorch sees one."""

    def __post_init__(self) -> None:
        check_source(self.start, START)
        if self.steps < 1 or not self.lr > 0:
            raise InputError(
                f"sucre_paper: steps is {self.steps}, lr {self.lr}; both must be positive"
            )

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
        start, water = start_of(observations, view.rgb.reshape(-1, 3)), _INITIAL_WATER
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
    water: WaterParameters = _INITIAL_WATER,
) -> Solution:
    """Take Adam's steps from J = start (3, P) and a water, full batch, without bounds, and return its last iterate.

    Raises SolveError when it diverges.
    """
    import torch

    # torch.optim.Adam imports PyTorch's compiler at its first step, for a second
    from torch.optim.adam import (
        adam,
    )

    # the same as dividing the sum
    eps = _EPS if options.objective == "sum" else _EPS * 3 * len(observations)
    tied, (_, place) = options.one_coefficient, backend_for("torch", options.device)
    J_now, columns = (
        torch.tensor(start, dtype=torch.float32, device=place),
        [0, 1, 1 if tied else 2],
    )
    water_now = torch.tensor(water.by_channel()[:, columns]).contiguous()  # as the gradient is
    J_grad, unknowns = torch.zeros_like(J_now), [J_now, water_now]
    means, squares = ([torch.zeros_like(unknown) for unknown in unknowns] for _ in range(2))
    counts = [torch.zeros((), device=unknown.device) for unknown in unknowns]
    settings: Any = {
        "lr": options.lr,
        "eps": eps,
        "beta1": 0.9,
        "beta2": 0.999,
        "weight_decay": 0,
        "amsgrad": False,
    }
    with squared_error(observations, place) as evaluate:
        cost, water_grad = evaluate(J_now, water_now, J_grad)
        first = cost
        for _ in track(range(options.steps), "SUCRe (Adam)"):
            if tied:
                water_grad[:, 1:] = water_grad[:, 1:].sum(dim=1, keepdim=True)
            gradients = [J_grad, water_grad]
            # fused: one pass over memory, not ten
            adam(
                unknowns,
                gradients,
                means,
                squares,
                [],
                counts,
                fused=True,
                maximize=False,
                **settings,
            )
            cost, water_grad = evaluate(J_now, water_now, J_grad)
    if not cost.isfinite().all():
        raise SolveError(
            f"Adam diverged after {options.steps} steps; lower lr ({options.lr}) or steps"
        )
    found = WaterParameters.of_channels(water_now.numpy()[:, columns])
    with opened(observations, "torch", options.device) as kernel:
        uncertainty = uncertainty_of(
            found, kernel.system(found), None, observations.n_excess, tied=tied
        )
        _, deviation = kernel.colours(found, uncertainty.noise, uncertainty.covariance)
    course = Course(solver="adam", device=place, steps=options.steps, initial_cost=first.numpy())
    return Solution(J_now.cpu().numpy(), deviation, found, cost.numpy(), uncertainty, course)


@contextmanager
def squared_error(
    observations: Observations, device: str = "cpu", block_px: int | None = None
) -> Iterator[
    Callable[[torch.Tensor, torch.Tensor, torch.Tensor], tuple[torch.Tensor, torch.Tensor]]
]:
    """Move the observations to a device for the time of a `with` block; return what evaluates eq. 7 and its gradient.

    Its arguments are J (3, P), the water (3, 3), a row a channel, columns B, beta, gamma, and dE/dJ (3, P), which it
    writes. It returns the cost (3,) and dE/dwater (3, 3), float64 on the CPU. Sums are added up in the order of the
    blocks, whatever thread made them: equal runs give equal results.
    block_px: pixels worked on at once; None: what was fastest on the device. It changes sums by rounding only.
    """
    import torch

    size = block_px or _BLOCK_PX[device]
    starts = range(0, len(observations.pixels), size)
    blocks = [
        (start, list(observations.slots(start, start + size)), c)
        for start in starts
        for c in range(3)
    ]
    distance, colour = (
        torch.from_numpy(v).to(device) for v in (observations.distance, observations.colour)
    )

    def evaluate(
        J: torch.Tensor, water: torch.Tensor, J_grad: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        rows = water.tolist()
        sums = torch.zeros(len(blocks), 4, dtype=torch.float64, device=J.device)

        def work(k: int) -> None:
            start, slots, c = blocks[k]
            B, beta, gamma = rows[c]
            J_grad[c, start : start + slots[0][0]].zero_()
            for n, part in slots:
                pixels, z = slice(start, start + n), distance[part]
                a, D_B, D_beta, D_gamma = derivatives(J[c, pixels], z, B, beta, gamma)
                r = colour[c, part] * observations.scale - (J[c, pixels] * a + B * D_B)
                J_grad[c, pixels].addcmul_(r, a, value=-2)
                sums[k] += torch.stack([r @ r, r @ D_B, r @ D_beta, r @ D_gamma])

        list(workers.map(work, range(len(blocks))))
        # blocks of one start are the three channels
        total = sums.cpu().reshape(-1, 3, 4).sum(dim=0)
        return total[:, 0], -2 * total[:, 1:].contiguous()

    with (
        one_torch_thread() as n_threads,
        ThreadPoolExecutor(n_threads if device == "cpu" else 1) as workers,
    ):
        yield evaluate
