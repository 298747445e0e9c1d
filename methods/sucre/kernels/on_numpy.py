"""The passes in NumPy and float64: slow, and what the other backends are held to."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.methods.sucre.kernels.dense import blocks, colours, fill, products
from sucre_bench.methods.sucre.reduced import ReducedSystem
from sucre_bench.multiview.observations import Observations

__all__ = ["on_numpy"]

_ELEMENTS = 1 << 14  # places in a block: temporaries stay in the cache


@dataclass(frozen=True, slots=True, eq=False)
class _NumpyKernel:
    observations: Observations
    device: str = "cpu"

    def system(self, water: Array, margin: Array | None = None) -> ReducedSystem:
        seen = self.observations
        stop = None if margin is not None else seen.n_repeated
        total = np.zeros((3, 4, 4))
        for block in blocks(seen, _ELEMENTS, stop=stop):
            z, I, w = fill(seen, block, np.float64)  # noqa: E741
            s = np.sqrt(w)
            for c in range(3):
                total[c] += products(z, I[c], s, water[c], None if margin is None else margin[c], np.stack)
        return ReducedSystem.from_products(total)

    def colours(self, water: Array, noise: Array, covariance: Array) -> tuple[Array, Array]:
        J, deviation = np.empty((2, 3, len(self.observations.pixels)), dtype=np.float32)
        for block in blocks(self.observations, _ELEMENTS):
            z, I, w = fill(self.observations, block, np.float64)  # noqa: E741
            s = np.sqrt(w)
            here = slice(block.start, block.start + block.n)
            for c in range(3):
                J[c, here], deviation[c, here] = colours(z, I[c], s, water[c], noise[c], covariance[c])
        return J, deviation


@contextmanager
def on_numpy(observations: Observations) -> Iterator[_NumpyKernel]:
    """Open the observations for NumPy."""
    yield _NumpyKernel(observations)
