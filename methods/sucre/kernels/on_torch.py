"""The passes in PyTorch: on the CPU several blocks at a time, on a GPU block after block.

float32 inside a block, float64 across. Blocks are filled when they are worked, from memory or from disk, so that a
GPU holds one block at a time and its memory limits nothing but the size of a block.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.machine.cores import usable_cores
from sucre_bench.methods.sucre.kernels.dense import Block, blocks, colours, fill, products
from sucre_bench.methods.sucre.reduced import ReducedSystem
from sucre_bench.multiview.observations import Observations

__all__ = ["on_torch"]

# Places in a block. CPU: temporaries of 0.25 MB stay in the cache. GPU: launches dominate until a block fills it.
_ELEMENTS = {"cpu": 1 << 16, "cuda": 1 << 24}


@dataclass(frozen=True, slots=True, eq=False)
class _TorchKernel:
    observations: Observations
    device: str
    workers: ThreadPoolExecutor

    def system(self, water: Array, margin: Array | None = None) -> ReducedSystem:
        import torch

        def work(block: Block) -> Array:
            z, I, s = self._on_device(block)  # noqa: E741
            held = [None] * 3 if margin is None else margin.tolist()
            parts = [products(z, I[c], s, water[c].tolist(), held[c], torch.stack) for c in range(3)]
            return torch.stack(parts).double().cpu().numpy()

        stop = None if margin is not None else self.observations.n_repeated
        return ReducedSystem.from_products(sum(self._each(work, stop), np.zeros((3, 4, 4))))

    def colours(self, water: Array, noise: Array, covariance: Array) -> tuple[Array, Array]:
        import torch

        J, deviation = np.empty((2, 3, len(self.observations.pixels)), dtype=np.float32)

        def work(block: Block) -> None:
            z, I, s = self._on_device(block)  # noqa: E741
            here = slice(block.start, block.start + block.n)
            of = [colours(z, I[c], s, water[c].tolist(), float(noise[c]), covariance[c].tolist()) for c in range(3)]
            J[:, here] = torch.stack([one[0] for one in of]).cpu().numpy()
            deviation[:, here] = torch.stack([one[1] for one in of]).cpu().numpy()

        list(self._each(work, None))
        return J, deviation

    def _each(self, work: Callable[[Block], Any], stop: int | None) -> Iterator[Any]:
        """Work every block; results come in the order of the blocks, whatever thread made them."""
        cut = blocks(self.observations, _ELEMENTS[self.device], stop=stop)
        for results in self.workers.map(partial(_in_pieces, work), cut):
            yield from results

    def _on_device(self, block: Block) -> tuple[Any, Any, Any]:
        import torch

        z, I, w = (torch.from_numpy(part).to(self.device) for part in fill(self.observations, block))  # noqa: E741
        return z, I, w.sqrt_()


def _in_pieces(work: Callable[[Block], Any], block: Block) -> list[Any]:
    """Work a block, in halves where a GPU has not the memory for it."""
    import torch

    try:
        return [work(block)]
    except torch.OutOfMemoryError:
        if block.n == 1:
            raise
    torch.cuda.empty_cache()
    half = block.n // 2
    rest = Block(block.start + half, block.n - half, block.slots)
    return [*_in_pieces(work, replace(block, n=half)), *_in_pieces(work, rest)]


@contextmanager
def on_torch(observations: Observations, device: str) -> Iterator[_TorchKernel]:
    """Open the observations for PyTorch on "cpu" or "cuda".

    On the CPU one thread an operation and several blocks at a time: an operation on a block takes some 20 us, less
    than it costs to gather threads for it, and a thread that others have displaced would hold up every one.
    """
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with ThreadPoolExecutor(usable_cores() if device == "cpu" else 1) as workers:
            yield _TorchKernel(observations, device, workers)
    finally:
        torch.set_num_threads(threads)
