"""The two solvers on every backend and device of this machine, on the same observations, in one run.

Run: python benchmarks/devices.py [WIDTH or FOLDER ...]. A width makes the demo scene, 3/4 as high; a folder has the
layout of the colmap dataset. The view in the middle is restored. The fastest of three solves counts, after one that
compiles; it starts with the observations in the machine's memory. Ratios are to PyTorch on the CPU. Water and J are
beside those of the float64 reference (backend "numpy"); above 2 million observations the first line stands in for it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from solvers import fastest

import sucre_bench as sb
from sucre_bench.errors import InputError
from sucre_bench.machine.compute import usable_cores
from sucre_bench.methods.sucre.models import fit_water
from sucre_bench.methods.sucre.paper import SucrePaper, solve_adam, start_of
from sucre_bench.methods.sucre.solution import Solution
from sucre_bench.multiview.observe import observe
from sucre_bench.scene import Scene

REFERENCE_AT_MOST = 2_000_000
PLACES = [
    ("numba", "cpu"),
    ("torch", "cpu"),
    ("torch", "cuda"),
    ("jax", "cpu"),
    ("jax", "cuda"),
]


def water_of(solution: Solution) -> Any:
    return np.stack([solution.water.B, solution.water.beta, solution.water.gamma])


def main() -> None:
    for word in sys.argv[1:] or ["640"]:
        compare_on(scene_of(word))


def scene_of(word: str) -> Scene:
    if word.isdecimal():
        return next(sb.load_scenes("demo", width=int(word), height=int(word) * 3 // 4))
    return next(sb.load_scenes("colmap", root=word))


def compare_on(scene: Scene) -> None:
    view = scene.views[len(scene.views) // 2]
    observations = observe(view, scene.views)
    start = start_of(observations, view.rgb.reshape(-1, 3))
    print(
        f"\n{len(observations):,} observations of {len(observations.pixels):,} pixels, {usable_cores()} cores"
    )
    print(f"{'':24}{'seconds':>9}{'ratio':>8}{'water differs by':>18}{'J by at most':>14}")

    def exact(backend: Any, device: Any) -> Callable[[], Solution]:
        place = {"backend": backend, "device": device}
        return lambda: fit_water(observations, **place).colours_of(observations, **place)

    def adam(device: Any) -> Callable[[], Solution]:
        return lambda: solve_adam(observations, start, SucrePaper(device=device))

    reference = exact("numpy", "cpu")() if len(observations) <= REFERENCE_AT_MOST else None
    table(
        reference,
        {f"exact, {b} on {d}": exact(b, d) for b, d in PLACES},
        of="exact, torch on cpu",
    )
    table(
        None, {f"adam, torch on {d}": adam(d) for d in ("cpu", "cuda")}, of="adam, torch on cpu"
    )


def table(
    reference: Solution | None, works: dict[str, Callable[[], Solution]], of: str
) -> None:
    found = {}
    for name, work in works.items():
        try:
            found[name] = fastest(work)
        except InputError as missing:
            print(f"{name:24}{missing}")
    for name, (seconds, solution) in found.items():
        reference = reference or solution
        ratio = found[of][0] / seconds
        water = np.abs(water_of(solution) / water_of(reference) - 1).max()
        J = np.nanmax(np.abs(solution.J - reference.J))
        print(f"{name:24}{seconds:9.3f}{ratio:8.1f}{water:18.1e}{J:14.1e}")


if __name__ == "__main__":
    main()
