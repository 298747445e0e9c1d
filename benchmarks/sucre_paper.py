"""How long the paper's optimisation takes here, beside the same steps written plainly with automatic differentiation.

Run: python benchmarks/sucre_paper.py [steps]. Both fit one view of the demo scene from the same start on the same
machine in the same run, in turns; the ratio of their fastest turns is what to compare between machines.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np
import torch

import sucre_bench as sb
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.paper import minimise
from sucre_bench.multiview.observations import Observations
from sucre_bench.multiview.observe import observe

START = np.full((3, 3), 0.1)  # rows B, beta, gamma
TURNS = 3


def plain(observations: Observations, own: np.ndarray, steps: int) -> np.ndarray:
    """Eq. 7 by autograd: a gather per observation, the whole graph kept, torch's own threads."""
    pixel = torch.from_numpy(np.concatenate([np.arange(n) for n, _ in observations.slots()]))
    z = torch.from_numpy(observations.distance)
    seen = torch.from_numpy(observations.intensity(slice(None)))
    J = torch.tensor(own, requires_grad=True)
    water = torch.tensor(START, dtype=torch.float32, requires_grad=True)
    adam = torch.optim.Adam([J, water], lr=0.05)
    for _ in range(steps):
        adam.zero_grad()
        B, beta, gamma = water[:, :, None]
        ((seen - J[:, pixel] * torch.exp(-beta * z) - B * (1 - torch.exp(-gamma * z))) ** 2).sum().backward()
        adam.step()
    return water.detach().numpy()


def timed(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def main() -> None:
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    scene = next(sb.load_scenes("demo"))
    view = scene.views[len(scene) // 2]
    observe(view, scene.views)  # decodes and caches the images
    pairing = min(timed(lambda: observe(view, scene.views)) for _ in range(TURNS))
    observations = observe(view, scene.views)
    own = np.ascontiguousarray(view.rgb.reshape(-1, 3)[observations.pixels].T)

    ours = minimise(observations, own, WaterParameters(*START), steps=steps, lr=0.05, device="cpu").water
    theirs = plain(observations, own, steps)
    assert np.allclose([ours.B, ours.beta, ours.gamma], theirs, atol=1e-4), (
        "the two must take the same steps to be compared"
    )
    turns = [
        (
            timed(lambda: minimise(observations, own, WaterParameters(*START), steps=steps, lr=0.05, device="cpu")),
            timed(lambda: plain(observations, own, steps)),
        )
        for _ in range(TURNS)
    ]
    fast, slow = (min(column) / steps for column in zip(*turns, strict=True))
    print(f"{len(observations):,} observations of {len(observations.pixels):,} pixels in {len(scene)} views")
    print(f"pairing              {pairing:8.2f} s")
    print(
        f"a step               {fast * 1e3:8.1f} ms   {3 * len(observations) / fast / 1e6:.0f} M observation-channels/s"
    )
    print(f"a step, by autograd  {slow * 1e3:8.1f} ms")
    print(f"ratio                {slow / fast:8.1f}")


if __name__ == "__main__":
    main()
