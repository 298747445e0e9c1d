"""The passes in JAX, compiled by XLA: block after block on a GPU, several at a time on the CPU.

XLA compiles once for every shape. So blocks have few shapes: 1, 2, 3, 4, 6, 8, 12, 16, 24 ... slots, as many pixels as
fill a block, and a power of two of them in the last block.

float32 inside a block, float64 across. JAX's own setting for float64 stays as it is.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.methods.sucre.kernels.blockwise import BlockKernel, open_blockwise
from sucre_bench.methods.sucre.kernels.formulas import Block, at_once, colours, fill, products, row_by_row
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.multiview.observations import Observations

# Places in a block. CPU: temporaries stay in the cache. GPU: launches dominate until a block fills it.
_PLACES = {"cpu": 1 << 16, "cuda": 1 << 23}


@dataclass(frozen=True, slots=True, eq=False)
class _Jax:
    observations: Observations
    device: str

    def products(self, block: Block, water: WaterParameters, margin: Array | None) -> Array:
        compute, _ = _compiled(self.device)
        held = None if margin is None else _float32(margin)
        found = compute(*self._on_device(block), _float32(water.by_channel()), held)
        return np.asarray(found, dtype=np.float64)

    def colours(self, block: Block, water: WaterParameters, noise: Array, covariance: Array) -> tuple[Array, Array]:
        _, compute = _compiled(self.device)
        parameters = (_float32(values) for values in (water.by_channel(), noise, covariance))
        J, deviation = compute(*self._on_device(block), *parameters)
        return np.asarray(J)[:, : block.n], np.asarray(deviation)[:, : block.n]

    def _on_device(self, block: Block) -> Any:
        import jax

        full = max(1, _PLACES[self.device] // block.slots)
        rectangles = fill(self.observations, block, width=min(_power_of_two(block.n), full))
        return jax.device_put(rectangles, jax.devices("gpu" if self.device == "cuda" else "cpu")[0])


def _float32(values: Array) -> Array:
    return np.asarray(values, dtype=np.float32)


def _power_of_two(n: int) -> int:
    """The smallest power of two that is at least n."""
    return 1 << (n - 1).bit_length()


def _few_sizes(n: int) -> int:
    """The smallest power of two, or three quarters of one, that is at least n."""
    power = _power_of_two(n)
    return power * 3 // 4 if n <= power * 3 // 4 else power


@functools.cache
def _compiled(device: str) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return `products` (3, 4, 4) and `colours` (two arrays (3, n)) of the three channels."""
    import jax

    def squares(columns: Any) -> Any:
        return at_once(columns) if device == "cpu" else row_by_row(columns, jax.numpy.stack)

    def all_products(z: Any, I: Any, w: Any, water: Any, margin: Any) -> Any:  # noqa: E741
        s, held = w**0.5, [None] * 3 if margin is None else margin
        of = [products(z, I[c], s, water[c], held[c], jax.numpy.stack, squares) for c in range(3)]
        return jax.numpy.stack(of)

    def all_colours(z: Any, I: Any, w: Any, water: Any, noise: Any, covariance: Any) -> Any:  # noqa: E741
        s = w**0.5
        found = [colours(z, I[c], s, water[c], noise[c], covariance[c]) for c in range(3)]
        return tuple(jax.numpy.stack(values) for values in zip(*found, strict=True))

    return jax.jit(all_products), jax.jit(all_colours)


def on_jax(observations: Observations, device: str) -> AbstractContextManager[BlockKernel]:
    """Open the observations for JAX on "cpu" or "cuda"."""
    return open_blockwise(observations, _Jax(observations, device), _PLACES[device], _few_sizes)
