"""The paper's optimiser: Adam on all unknowns at once (SUCRe, sec. 4, Optimization; Kingma & Ba 2015).

Minimised is eq. 7, for each channel the sum over all observations i of all pixels p

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

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sucre_bench.arrays import Array
from sucre_bench.machine.progress import track
from sucre_bench.methods.sucre.model import WaterParameters, derivatives
from sucre_bench.multiview.observations import Observations

if TYPE_CHECKING:
    import torch

# Pixels in a block. CPU: 0.5 MB an array; 200 evaluations of 3.15 M observations on 2 cores took 11.5 s with 2^15,
# where calls dominate, 8.2 s with 2^16, 8.5 s with 2^17, 9.3 s with 2^18; larger ones suffer less on a busy machine.
# GPU: launches dominate until a block fills the device.
_BLOCK_PX = {"cpu": 1 << 17, "cuda": 1 << 22}


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Adam's last iterate.

    J: (3, P) float32, intensities without water; cost, initial_cost: (3,) float64, sum of squared residuals of each
    channel.
    """

    J: Array
    water: WaterParameters
    cost: Array
    initial_cost: Array


def minimise(
    observations: Observations,
    J: Array,
    water: WaterParameters,
    *,
    steps: int = 200,
    lr: float = 0.05,
    eps: float = 1e-8,
    device: str = "cpu",
) -> Fit:
    """Take Adam's steps from J (3, P) and a water, full batch, without bounds."""
    import torch

    J_now = torch.tensor(J, dtype=torch.float32, device=device)
    water_now = torch.tensor(water.by_channel())
    J_grad = torch.zeros_like(J_now)
    adam = Adam([J_now, water_now], lr=lr, eps=eps, fused=True)  # fused: one pass over memory, not ten
    with Objective.on(observations, device) as objective:
        first = None
        for _ in track(range(steps), "SUCRe (Adam)"):
            cost, water_grad = objective.evaluate(J_now, water_now, J_grad)
            first = cost if first is None else first
            adam.step([J_grad, water_grad])
        cost, _ = objective.evaluate(J_now, water_now, J_grad)
    first = cost if first is None else first
    return Fit(J_now.cpu().numpy(), WaterParameters.of_channels(water_now.numpy()), cost.numpy(), first.numpy())


class Adam:
    """PyTorch's Adam, without `torch.optim.Adam`: its first step imports PyTorch's compiler, which takes a second."""

    def __init__(self, unknowns: list[torch.Tensor], lr: float, eps: float, fused: bool = False) -> None:
        import torch

        self.unknowns, self.lr, self.eps, self.fused = unknowns, lr, eps, fused
        self._means = [torch.zeros_like(unknown) for unknown in unknowns]
        self._squares = [torch.zeros_like(unknown) for unknown in unknowns]
        self._steps = [torch.zeros((), device=unknown.device if fused else "cpu") for unknown in unknowns]

    def step(self, gradients: list[torch.Tensor]) -> None:
        """Change the unknowns by their gradients."""
        from torch.optim.adam import adam

        adam(
            self.unknowns,
            gradients,
            self._means,
            self._squares,
            [],
            self._steps,
            fused=self.fused,
            amsgrad=False,
            beta1=0.9,
            beta2=0.999,
            lr=self.lr,
            weight_decay=0,
            eps=self.eps,
            maximize=False,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Objective:
    """Eq. 7 and its gradient over observations that lie on a device.

    distance: (N,) float32; colour: (3, N) uint8 or float32; scale: brings it to [0, 1];
    blocks: (channel, start, slots) each: pixels from start on, and their slots (n, part);
    workers: threads, each with a share of the blocks.
    """

    distance: torch.Tensor
    colour: torch.Tensor
    scale: float
    blocks: list[tuple[int, int, list[tuple[int, slice]]]]
    workers: ThreadPoolExecutor
    n_workers: int

    @staticmethod
    @contextmanager
    def on(observations: Observations, device: str = "cpu", block_px: int | None = None) -> Iterator[Objective]:
        """Move the observations to a device for the time of a `with` block.

        block_px: pixels worked on at once; None: what was fastest on the device. It changes sums by rounding only.
        """
        import torch

        size = block_px or _BLOCK_PX[device]
        starts = range(0, len(observations.pixels), size)
        blocks = [(c, start, list(observations.slots(start, start + size))) for start in starts for c in range(3)]
        distance = torch.from_numpy(observations.distance).to(device)
        colour = torch.from_numpy(observations.colour).to(device)
        # One thread an operation and several blocks at a time: an operation on a block takes some 30 us, less than
        # gathering threads for it, and a displaced thread would hold up all the others.
        threads = torch.get_num_threads()
        n_workers = threads if device == "cpu" else 1
        torch.set_num_threads(1)
        try:
            with ThreadPoolExecutor(n_workers) as workers:
                yield Objective(distance, colour, observations.scale, blocks, workers, n_workers)
        finally:
            torch.set_num_threads(threads)

    def evaluate(self, J: torch.Tensor, water: torch.Tensor, J_grad: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the cost (3,) and dE/dwater (3, 3), float64 on the CPU, and write dE/dJ (3, P) to J_grad.

        water: (3, 3) and its gradient have a row a channel, columns B, beta, gamma.

        Sums are added up in the order of the blocks, whatever thread made them: equal runs give equal results.
        """
        import torch

        rows = water.tolist()
        sums = torch.zeros(len(self.blocks), 4, dtype=torch.float64, device=J.device)

        def work(worker: int) -> None:
            for k in range(worker, len(self.blocks), self.n_workers):
                channel, start, slots = self.blocks[k]
                pixels = slice(start, start + slots[0][0])
                self._block(channel, slots, J[channel, pixels], rows[channel], J_grad[channel, pixels], sums[k])

        list(self.workers.map(work, range(self.n_workers)))
        total = sums.cpu().reshape(-1, 3, 4).sum(dim=0)  # blocks of one start are the three channels
        return total[:, 0], -2 * total[:, 1:].contiguous()

    def _block(
        self,
        channel: int,
        slots: list[tuple[int, slice]],
        J_all: torch.Tensor,
        water: list[float],
        J_grad: torch.Tensor,
        sums: torch.Tensor,
    ) -> None:
        """Write dE/dJ of a block's pixels; add sum r^2 and sum r D of B, beta, gamma to sums (4,)."""
        import torch

        B, beta, gamma = water
        J_grad.zero_()
        for n, part in slots:
            J, z = J_all[:n], self.distance[part]
            a, D_B, D_beta, D_gamma = derivatives(J, z, B, beta, gamma)
            r = self.colour[channel, part] * self.scale - (J * a + B * D_B)
            J_grad[:n].addcmul_(r, a, value=-2)
            sums += torch.stack([r @ r, r @ D_B, r @ D_beta, r @ D_gamma])
