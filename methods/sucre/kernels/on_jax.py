"""The passes in JAX, compiled by XLA: block after block on a GPU, several at a time on the CPU.

XLA compiles once for every shape. Blocks are therefore filled up to few: 1, 2, 3, 4, 6, 8, 12, 16, 24 ... slots, as
many pixels as make a full block, and a power of two of them in the last.

float32 inside a block, float64 across, so that JAX's own setting for float64 stays as it is.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.machine.cores import usable_cores
from sucre_bench.methods.sucre.kernels.dense import Block, blocks, colours, fill, products
from sucre_bench.methods.sucre.reduced import ReducedSystem
from sucre_bench.multiview.observations import Observations

__all__ = ["on_jax"]

# Places in a block. CPU: temporaries stay in the cache. GPU: launches dominate until a block fills it.
_ELEMENTS = {"cpu": 1 << 16, "cuda": 1 << 23}


@dataclass(frozen=True, slots=True, eq=False)
class _JaxKernel:
    observations: Observations
    device: str
    workers: ThreadPoolExecutor

    def system(self, water: Array, margin: Array | None = None) -> ReducedSystem:
        compute = _compiled()[0]
        rows, held = _float32(water), None if margin is None else _float32(margin)

        def work(block: Block) -> Array:
            return np.asarray(compute(*self._on_device(block), rows, held), dtype=np.float64)

        stop = None if margin is not None else self.observations.n_repeated
        return ReducedSystem.from_products(sum(self._each(work, stop), np.zeros((3, 4, 4))))

    def colours(self, water: Array, noise: Array, covariance: Array) -> tuple[Array, Array]:
        compute = _compiled()[1]
        parameters = _float32(water), _float32(noise), _float32(covariance)
        J, deviation = np.empty((2, 3, len(self.observations.pixels)), dtype=np.float32)

        def work(block: Block) -> None:
            here = slice(block.start, block.start + block.n)
            found = compute(*self._on_device(block), *parameters)
            J[:, here], deviation[:, here] = (np.asarray(values)[:, : block.n] for values in found)

        list(self._each(work, None))
        return J, deviation

    def _each(self, work: Callable[[Block], Any], stop: int | None) -> Iterator[Any]:
        return self.workers.map(work, blocks(self.observations, _ELEMENTS[self.device], stop=stop, slots=_few_sizes))

    def _on_device(self, block: Block) -> Any:
        import jax

        full = max(1, _ELEMENTS[self.device] // block.slots)
        rectangles = fill(self.observations, block, width=min(_power_of_two(block.n), full))
        return jax.device_put(rectangles, jax.devices("gpu" if self.device == "cuda" else "cpu")[0])


def _float32(values: Array) -> Array:
    return np.asarray(values, dtype=np.float32)


def _power_of_two(n: int) -> int:
    """The next one from n on."""
    return 1 << (n - 1).bit_length()


def _few_sizes(n: int) -> int:
    """The next power of two from n on, or three quarters of it."""
    power = _power_of_two(n)
    return power * 3 // 4 if n <= power * 3 // 4 else power


@functools.cache
def _compiled() -> tuple[Callable[..., Any], Callable[..., Any]]:
    """`products` (3, 4, 4) and `colours` (3, n) twice, of the three channels."""
    import jax

    def all_products(z: Any, I: Any, w: Any, water: Any, margin: Any) -> Any:  # noqa: E741
        s, held = w**0.5, [None] * 3 if margin is None else margin
        with jax.default_matmul_precision("highest"):  # a GPU would take 10 bits of the products for enough
            return jax.numpy.stack([products(z, I[c], s, water[c], held[c], jax.numpy.stack) for c in range(3)])

    def all_colours(z: Any, I: Any, w: Any, water: Any, noise: Any, covariance: Any) -> Any:  # noqa: E741
        s = w**0.5
        found = [colours(z, I[c], s, water[c], noise[c], covariance[c]) for c in range(3)]
        return tuple(jax.numpy.stack(values) for values in zip(*found, strict=True))

    return jax.jit(all_products), jax.jit(all_colours)


@contextmanager
def on_jax(observations: Observations, device: str) -> Iterator[_JaxKernel]:
    """Open the observations for JAX on "cpu" or "cuda"."""
    with ThreadPoolExecutor(usable_cores() if device == "cpu" else 1) as workers:
        yield _JaxKernel(observations, device, workers)
