"""A kernel that works block by block, for array libraries that compute with rectangles (NumPy, PyTorch, JAX)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.machine.compute import usable_cores
from sucre_bench.methods.sucre.kernels.formulas import Block, blocks
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.normal_equations import ReducedSystem
from sucre_bench.multiview.observations import Observations

T = TypeVar("T")


class Library(Protocol):
    """What an array library computes for one block; see formulas.py for both."""

    @property
    def device(self) -> str:
        """Where it computes: "cpu" or "cuda"."""
        ...

    def products(self, block: Block, water: WaterParameters, margin: Array | None) -> Array:
        """Return the products (3, 4, 4) float64."""
        ...

    def colours(self, block: Block, water: WaterParameters, noise: Array, covariance: Array) -> tuple[Array, Array]:
        """Return J and its standard deviation, (3, n) each."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class BlockKernel:
    """The passes as sums over blocks of at most `places` places.

    slots: how many slots to give a block that needs so many. Results come in the order of the blocks, whatever thread
    made them, so that equal runs give equal sums.
    """

    observations: Observations
    library: Library
    places: int
    slots: Callable[[int], int]
    workers: ThreadPoolExecutor

    @property
    def device(self) -> str:
        return self.library.device

    def system(self, water: WaterParameters, margin: Array | None = None) -> ReducedSystem:
        stop = self.observations.n_repeated if margin is None else None
        parts = self._each(lambda block: self.library.products(block, water, margin), stop)
        return ReducedSystem.from_products(sum((part for _, part in parts), np.zeros((3, 4, 4))))

    def colours(self, water: WaterParameters, noise: Array, covariance: Array) -> tuple[Array, Array]:
        J, deviation = np.empty((2, 3, len(self.observations.pixels)), dtype=np.float32)
        parts = self._each(lambda block: self.library.colours(block, water, noise, covariance), None)
        for block, (block_J, block_deviation) in parts:
            here = slice(block.start, block.start + block.n)
            J[:, here], deviation[:, here] = block_J, block_deviation
        return J, deviation

    def _each(self, work: Callable[[Block], T], stop: int | None) -> Iterator[tuple[Block, T]]:
        cut = blocks(self.observations, self.places, stop=stop, slots=self.slots)
        return zip(cut, map(work, cut) if len(cut) == 1 else self.workers.map(work, cut), strict=True)


@contextmanager
def open_blockwise(
    observations: Observations, library: Library, places: int, slots: Callable[[int], int] = int
) -> Iterator[BlockKernel]:
    """Open the observations for a library: several blocks at a time on the CPU, block after block on a GPU."""
    with ThreadPoolExecutor(usable_cores() if library.device == "cpu" else 1) as workers:
        yield BlockKernel(observations, library, places, slots, workers)
