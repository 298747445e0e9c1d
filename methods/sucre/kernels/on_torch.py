"""The passes in PyTorch: on the CPU several blocks at a time, on a GPU block after block.

float32 inside a block, float64 across. A block is filled when its turn comes, from memory or from disk. So a GPU holds
one block at a time, and its memory limits only the size of a block.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.methods.sucre.kernels.blockwise import BlockKernel, open_blockwise
from sucre_bench.methods.sucre.kernels.formulas import Block, at_once, colours, fill, products, row_by_row
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.multiview.observations import Observations

T = TypeVar("T")

# Places in a block. CPU: temporaries of 0.25 MB stay in the cache. GPU: launches dominate until a block fills it.
_PLACES = {"cpu": 1 << 16, "cuda": 1 << 24}


@dataclass(frozen=True, slots=True, eq=False)
class _Torch:
    observations: Observations
    device: str

    def products(self, block: Block, water: WaterParameters, margin: Array | None) -> Array:
        import torch

        def work(part: Block) -> Array:
            z, I, s = self._on_device(part)  # noqa: E741
            held = [None] * 3 if margin is None else margin.tolist()
            parts = [products(z, I[c], s, water.channel(c), held[c], torch.stack, self._squares) for c in range(3)]
            return torch.stack(parts).double().cpu().numpy()

        return np.sum(_in_pieces(work, block), axis=0)

    def colours(self, block: Block, water: WaterParameters, noise: Array, covariance: Array) -> tuple[Array, Array]:
        import torch

        def work(part: Block) -> Array:
            z, I, s = self._on_device(part)  # noqa: E741
            of = [colours(z, I[c], s, water.channel(c), float(noise[c]), covariance[c].tolist()) for c in range(3)]
            return torch.stack([torch.stack(pair) for pair in of], dim=1).cpu().numpy()  # (2, 3, n)

        J, deviation = np.concatenate(_in_pieces(work, block), axis=2)
        return J, deviation

    def _squares(self, columns: Any) -> Any:
        import torch

        return at_once(columns) if self.device == "cpu" else row_by_row(columns, torch.stack, dtype=torch.float64)

    def _on_device(self, block: Block) -> tuple[Any, Any, Any]:
        import torch

        z, I, w = (torch.from_numpy(part).to(self.device) for part in fill(self.observations, block))  # noqa: E741
        return z, I, w.sqrt_()


def _in_pieces(work: Callable[[Block], T], block: Block) -> list[T]:
    """Work a block, in halves where a GPU lacks the memory for it."""
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
def on_torch(observations: Observations, device: str) -> Iterator[BlockKernel]:
    """Open the observations for PyTorch on "cpu" or "cuda".

    On the CPU every operation has one thread and several blocks run at a time. An operation on a block takes some
    20 us, less than gathering threads for it costs, and a thread that is displaced would hold up all the others.
    """
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with open_blockwise(observations, _Torch(observations, device), _PLACES[device]) as kernel:
            yield kernel
    finally:
        torch.set_num_threads(threads)
