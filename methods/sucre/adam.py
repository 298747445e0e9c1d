"""Adam on all unknowns of SUCRe at once (SUCRe, sec. 4, Optimization; Kingma & Ba 2015).

Minimised is eq. 7, for each channel the sum over all observations i of all pixels p

    E = sum r^2,    r = I - J a - b,    a = exp(-beta z),    b = B (1 - exp(-gamma z))

with the gradient in closed form instead of by automatic differentiation over all observations:

    dE/dJ_p = -2 sum_i r a                          (over the observations of pixel p)
    dE/dtheta = -2 sum_p sum_i r D_theta            (theta in B, beta, gamma; D = dI/dtheta, see model.py)

Adam does not depend on the scale of E except through its eps, which is added to the size of a gradient. Minimising
E / (3 N) with eps is therefore minimising E with 3 N eps: at N = 3e6 observations and the usual 1e-8 that is 0.1, as
much as a pixel's own gradient, and colours lag behind the water; at 1e8 it is 3. The sum is safe at any N.

Float32 inside a block of pixels, float64 across. On a CPU the steps are compiled loops, on a GPU PyTorch's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sucre_bench.arrays import Array
from sucre_bench.machine.progress import track
from sucre_bench.methods.sucre.model import derivatives
from sucre_bench.multiview.observations import Observations

# Adam's own (Kingma & Ba 2015), which the paper does not change: how much a step keeps of its means; eps.
MEAN = 0.9
SQUARE = 0.999
EPS = 1e-8

PROGRESS = "SUCRe (Adam)"

# Pixels of a GPU's block: launches dominate until a block fills it.
_BLOCK_PX = 1 << 22


@dataclass(frozen=True, slots=True)
class Steps:
    """n steps of a rate."""

    n: int
    rate: float

    eps: float = EPS
    """Is added to the size of a gradient, see above."""

    is_tied: bool = False
    """Whether gamma is beta, the paper's eq. 1."""

    def shared(self, gradient: Any) -> Any:
        """Return the gradient (3, 3) of a water, with that of the one coefficient in two columns, if it is tied."""
        if not self.is_tied:
            return gradient
        gradient[:, 1:] = gradient[:, 1:].sum(1)[:, None]
        return gradient


@dataclass(frozen=True, slots=True, eq=False)
class Descent:
    """The last iterate, and the costs of the first and of the last."""

    J: Array
    """Shape (3, P), float32."""

    water: Array
    """Shape (3, 3), a row a channel, of B, beta, gamma."""

    first: Array
    """Cost (3,) of the first iterate."""

    cost: Array
    """Cost (3,) of the last iterate."""


def descend(
    observations: Observations, start: Array, water: Array, steps: Steps, device: str
) -> Descent:
    """Take steps from J = start (3, P) and a water (3, 3), full batch, without bounds."""
    if device == "cuda":
        return descend_on_torch(observations, start, water, steps, device)
    from sucre_bench.methods.sucre import adam_loops

    return adam_loops.descend(observations, start, water, steps)


def descend_on_torch(
    observations: Observations, start: Array, water: Array, steps: Steps, device: str
) -> Descent:
    """Take steps as `descend` does, with PyTorch."""
    import torch

    # torch.optim.Adam imports PyTorch's compiler at its first step, for a second
    from torch.optim.adam import adam

    J = torch.tensor(start, dtype=torch.float32, device=device)
    rows = torch.tensor(water)
    unknowns = [J, rows]
    means, squares = ([torch.zeros_like(unknown) for unknown in unknowns] for _ in range(2))
    counts = [torch.zeros((), device=unknown.device) for unknown in unknowns]
    distance, colour = (
        torch.from_numpy(values).to(device)
        for values in (observations.distance, observations.colour)
    )
    slope = torch.zeros_like(J)

    def evaluated() -> tuple[torch.Tensor, torch.Tensor]:
        """Return the cost (3,) and dE/dwater (3, 3), float64 on the CPU; dE/dJ is in `slope`."""
        total = torch.zeros(3, 4, dtype=torch.float64, device=device)
        slope.zero_()
        for start_px in range(0, len(observations.pixels), _BLOCK_PX):
            slots = list(observations.slots(start_px, start_px + _BLOCK_PX))
            for c, (B, beta, gamma) in enumerate(rows.tolist()):
                for n, part in slots:
                    pixels = slice(start_px, start_px + n)
                    a, *D = derivatives(J[c, pixels], distance[part], B, beta, gamma)
                    r = colour[c, part] * observations.scale - (J[c, pixels] * a + B * D[0])
                    slope[c, pixels].addcmul_(r, a, value=-2)
                    total[c] += torch.stack([r @ r, *(r @ column for column in D)])
        total = total.cpu()
        return total[:, 0], -2 * total[:, 1:].contiguous()

    cost, gradient = evaluated()
    first = cost
    for _ in track(range(steps.n), PROGRESS):
        # fused: one pass over memory, not ten
        adam(
            unknowns,
            [slope, steps.shared(gradient)],
            means,
            squares,
            [],
            counts,
            fused=True,
            maximize=False,
            lr=steps.rate,
            eps=steps.eps,
            beta1=MEAN,
            beta2=SQUARE,
            weight_decay=0,
            amsgrad=False,
        )
        cost, gradient = evaluated()
    return Descent(J.cpu().numpy(), rows.numpy(), first.numpy(), cost.numpy())
