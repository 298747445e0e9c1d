"""The exact solver against the number of observations: seconds, memory, and the speed of its two passes.

Run: python benchmarks/sucre_exact.py [--observations 1e8] [--backends numba,torch,jax,numpy]
     [--device cuda] [--turns 2]

A target has a tenth as many pixels as observations, each seen 1 to 19 times at 1 to 10 m, 8-bit colours with noise. For
each size and backend a process of its own makes the observations, then times a pass of either kind (the fastest of
some turns) and a whole restoration: the water of all observations, in so many passes over them, and all colours in it.
Peak memory is that of the restoration, with the observations it reads.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench.methods.sucre.exact import fit
from sucre_bench.methods.sucre.model import WaterParameters, transmission, veil
from sucre_bench.methods.sucre.passes import opened
from sucre_bench.multiview.observations import Observations

BACKENDS = ("numba", "torch", "jax", "numpy")
ON_GPU = ("torch", "jax")
SIZES = (1e5, 1e6, 1e7, 1e8)
WATER = WaterParameters(
    np.array([0.06, 0.22, 0.30]), np.array([0.42, 0.14, 0.10]), np.array([0.30, 0.17, 0.13])
)
NOISE = 0.004
_BLOCK = 1 << 20  # observations made at a time


def made(n_pixels: int) -> Observations:
    """Ten observations a pixel on average, uniformly 1 to 19; nothing larger than a block beside the result."""
    rng = np.random.default_rng(0)
    counts = np.sort(rng.integers(1, 20, n_pixels, dtype=np.int32))[::-1].copy()
    sizes = n_pixels - np.cumsum(np.bincount(counts))[:-1]
    starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    distance, colour = (
        np.empty(starts[-1], dtype=np.float32),
        np.empty((3, starts[-1]), dtype=np.uint8),
    )
    J = rng.random((3, n_pixels), dtype=np.float32)
    observations = Observations(
        (1, n_pixels), ("made",), np.arange(n_pixels), counts, starts, distance, colour
    )
    for start in range(0, n_pixels, _BLOCK):
        for n, part in observations.slots(start, start + _BLOCK):
            z = distance[part] = 1 + 9 * rng.random(n, dtype=np.float32)
            noise = np.float32(NOISE) * rng.standard_normal(n, dtype=np.float32)
            for c in range(3):
                B, beta, gamma = map(np.float32, WATER.by_channel()[c])
                seen = (
                    J[c, start : start + n] * transmission(z, beta) + veil(z, B, gamma) + noise
                )
                colour[c, part] = np.rint(255 * seen.clip(0, 1))
    return observations


def measure(n: float, backend: Any, device: Any, turns: int) -> dict[str, float]:
    """Measure one size with one backend in this process."""
    observations = made(round(n / 10))
    noise, covariance = np.full(3, NOISE), np.broadcast_to(1e-8 * np.eye(3), (3, 3, 3))

    passes_needed = []

    def restore() -> None:
        found = fit(observations, backend=backend, device=device)
        with opened(observations, backend, device) as kernel:
            kernel.colours(found.water, noise, covariance)
        passes_needed.append(found.passes)
        error = np.abs(found.water.by_channel() / WATER.by_channel() - 1).max()
        assert n < 1e6 or error < 0.02, f"a fast but wrong water: off by {error:.1%}"

    with opened(observations, backend, device) as kernel:
        passes = {
            "system": lambda: kernel.system(WATER),
            "held": lambda: kernel.system(WATER, np.full(3, 0.02)),
            "colours": lambda: kernel.colours(WATER, noise, covariance),
        }
        speed = {
            name: 3e-6 * len(observations) / fastest(work, turns)
            for name, work in passes.items()
        }
    Path("/proc/self/clear_refs").write_text("5")  # the peak from here on
    seconds = fastest(restore, turns)
    return {
        "observations": len(observations),
        **speed,
        "seconds": seconds,
        "passes": passes_needed[-1],
        "peak_gib": peak_gib(),
    }


def fastest(work: Callable[[], object], turns: int) -> float:
    """Seconds of the fastest of some turns, the first of which may have compiled."""
    times = []
    for _ in range(turns):
        started = time.perf_counter()
        work()
        times.append(time.perf_counter() - started)
    return min(times)


def peak_gib() -> float:
    line = next(
        line
        for line in Path("/proc/self/status").read_text().splitlines()
        if line.startswith("VmHWM")
    )
    return int(line.split()[1]) / 2**20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument(
        "--observations", type=float, help="one size alone; default: 1e5, 1e6, 1e7 and 1e8"
    )
    parser.add_argument(
        "--backends", help="default: numba,torch,jax,numpy; with --device cuda: torch,jax"
    )
    parser.add_argument(
        "--device", default="cpu", choices=("cpu", "cuda"), help="cuda: for torch and jax"
    )
    parser.add_argument("--turns", type=int, default=2)
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    on_gpu = arguments.device == "cuda"
    backends = (
        arguments.backends.split(",")
        if arguments.backends
        else list(ON_GPU if on_gpu else BACKENDS)
    )
    if arguments.child:
        print(
            json.dumps(
                measure(arguments.observations, backends[0], arguments.device, arguments.turns)
            )
        )
        return

    print(f"{'':13} {'':8}{'M observation-channels/s':>27}")
    heads = ("system", "held", "colours")
    columns = "".join(f"{head:>9}" for head in heads)
    print(
        f"{'observations':>13} {'backend':8}{columns}{'water + colours':>17}  passes        peak"
    )
    for n in [arguments.observations] if arguments.observations else SIZES:
        for backend in backends:
            one = [f"--observations={n}", f"--backends={backend}"]
            one += [f"--device={arguments.device}", f"--turns={arguments.turns}"]
            result = subprocess.run(
                [sys.executable, __file__, "--child", *one],
                check=True,
                stdout=subprocess.PIPE,
                text=True,
            )
            row: dict[str, Any] = {
                "backend": backend,
                **json.loads(result.stdout.splitlines()[-1]),
            }
            speeds = "".join(f"{row[name]:9.0f}" for name in heads)
            digits = max(0, 2 - math.floor(math.log10(row["seconds"])))
            whole = (
                f"{row['seconds']:15.{digits}f} s{row['passes']:8}{row['peak_gib']:8.2f} GiB"
            )
            print(f"{row['observations']:13,} {backend:8}{speeds}{whole}", flush=True)


if __name__ == "__main__":
    main()
