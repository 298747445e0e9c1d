"""The solvers of `sucre` beside one another: time of the solve, cost, and how far the water is from the truth.

Run: python benchmarks/solvers.py [backend [width]]. All fit the same observations of one view of the demo scene, on the
CPU, in one run; the ratio to the paper's 200 steps of Adam is what to compare between machines.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import sucre_bench as sb
from sucre_bench.methods.sucre.exact import fit
from sucre_bench.methods.sucre.models import fit_water
from sucre_bench.methods.sucre.paper import SucrePaper, solve_adam
from sucre_bench.methods.sucre.solution import Solution
from sucre_bench.multiview.observe import observe

TURNS = 3


def fastest(work: Callable[[], Solution]) -> tuple[float, Solution]:
    work()  # compiles
    times = []
    for _ in range(TURNS):
        started = time.perf_counter()
        solution = work()
        times.append(time.perf_counter() - started)
    return min(times), solution


def main() -> None:
    backend: Any = sys.argv[1] if len(sys.argv) > 1 else "torch"
    width = int(sys.argv[2]) if len(sys.argv) > 2 else 640
    scene = next(sb.load_scenes("demo", width=width, height=width * 3 // 4))
    view = scene.views[len(scene) // 2]
    observations = observe(view, scene.views)
    own = np.ascontiguousarray(view.rgb.reshape(-1, 3)[observations.pixels].T)
    assert scene.water is not None
    truth = np.array(
        [scene.water.veiling_light, scene.water.attenuation, scene.water.backscatter]
    )

    def exact(*, physical: bool) -> Solution:
        fitted = fit_water(observations, physical=physical, backend=backend, device="cpu")
        return fitted.colours_of(observations, backend=backend, device="cpu")

    # Adam's kernel is torch's; its water's cost and diagnosis, which are no part of the 200 steps, are few passes.
    works: dict[str, Callable[[], Solution]] = {
        "adam, 200 steps": lambda: solve_adam(observations, own, SucrePaper(device="cpu")),
        "exact": lambda: exact(physical=False),
        "exact, physical": lambda: exact(physical=True),
    }
    print(
        f"{len(observations):,} observations of {len(observations.pixels):,} pixels, backend {backend}"
    )
    print(f"{'':20}{'seconds':>10}{'ratio':>8}{'cost':>28}{'error of B, beta, gamma':>28}")
    paper = None
    for name, work in works.items():
        seconds, solution = fastest(work)
        paper = paper or seconds
        found = np.stack([solution.water.B, solution.water.beta, solution.water.gamma])
        error = np.abs(found / truth - 1).mean(axis=1) * 100
        cost = " ".join(f"{c:8.2f}" for c in solution.cost)
        print(f"{name:20}{seconds:10.3f}{paper / seconds:8.1f}{cost:>28}   {error.round(1)} %")
    costs = [
        fit(observations, backend=backend, device="cpu", seed=seed).cost.sum()
        for seed in range(3)
    ]
    print(f"exact from three samples: costs agree to {max(costs) / min(costs) - 1:.1e}")


if __name__ == "__main__":
    main()
