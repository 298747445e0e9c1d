"""The passes in NumPy and float64: slow, and the reference for the other backends."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.methods.sucre.kernels.blockwise import BlockKernel, open_blockwise
from sucre_bench.methods.sucre.kernels.formulas import Block, at_once, colours, fill, products
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.multiview.observations import Observations

_PLACES = 1 << 14  # in a block: temporaries stay in the cache


@dataclass(frozen=True, slots=True, eq=False)
class _NumPy:
    observations: Observations
    device: str = "cpu"

    def products(self, block: Block, water: WaterParameters, margin: Array | None) -> Array:
        z, I, s = self._block(block)  # noqa: E741
        held = [None] * 3 if margin is None else margin
        return np.stack([products(z, I[c], s, water.channel(c), held[c], np.stack, at_once) for c in range(3)])

    def colours(self, block: Block, water: WaterParameters, noise: Array, covariance: Array) -> tuple[Array, Array]:
        z, I, s = self._block(block)  # noqa: E741
        of = [colours(z, I[c], s, water.channel(c), noise[c], covariance[c]) for c in range(3)]
        return np.stack([J for J, _ in of]), np.stack([deviation for _, deviation in of])

    def _block(self, block: Block) -> tuple[Array, Array, Array]:
        z, I, w = fill(self.observations, block, np.float64)  # noqa: E741
        return z, I, np.sqrt(w)


def on_numpy(observations: Observations) -> AbstractContextManager[BlockKernel]:
    """Open the observations for NumPy."""
    return open_blockwise(observations, _NumPy(observations), _PLACES)
