"""The passes in PyTorch, JAX and NumPy: the formulas of passes.py on blocks, each filled when its turn comes.

So a GPU holds one block at a time, and its memory limits only the size of a block. PyTorch and JAX compute in float32
inside a block; sums across blocks are float64. NumPy computes in float64, the reference for the others.

XLA, which compiles for JAX, compiles once for every shape. So JAX's blocks have few shapes: 1, 2, 3, 4, 6, 8, 12, 16,
24 ... slots, as many pixels as fill a block, and a power of two of them in the last block. JAX's own setting for
float64 stays as it is.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.methods.sucre.passes import Block, BlockKernel, fill, open_blocks
from sucre_bench.multiview.observations import Observations

# Places in a block. CPU: temporaries of 0.2 MB stay in the cache. GPU: launches dominate until a block fills it.
_NUMPY = 1 << 13
_TORCH = {"cpu": 1 << 14, "cuda": 1 << 22}
_JAX = {"cpu": 1 << 14, "cuda": 1 << 21}


def on_numpy(observations: Observations) -> AbstractContextManager[BlockKernel]:
    """Open the observations for NumPy."""

    def compute(formula: Any, block: Block, *parameters: Any) -> Array:
        with np.errstate(divide="ignore"):  # by the information of pixels without any weight
            return np.asarray(formula(*fill(observations, block, np.float64), *parameters))

    return open_blocks(observations, "cpu", compute, _NUMPY)


@contextmanager
def on_torch(observations: Observations, device: str) -> Iterator[BlockKernel]:
    """Open the observations for PyTorch on "cpu" or "cuda".

    On the CPU every operation has one thread and several blocks run at a time. An operation on a block takes some
    20 us, less than gathering threads for it costs, and a thread that is displaced would hold up all the others.
    """
    import torch

    def moved(values: Array | None) -> torch.Tensor | None:
        return None if values is None else torch.from_numpy(values).to(device, torch.float32)

    def compute(formula: Any, block: Block, *parameters: Any) -> Array:
        try:
            found = formula(*map(moved, (*fill(observations, block), *parameters)))
            return np.asarray(found.cpu().numpy())
        except torch.OutOfMemoryError:
            pass
        torch.cuda.empty_cache()
        raise MemoryError

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with open_blocks(observations, device, compute, _TORCH[device]) as kernel:
            yield kernel
    finally:
        torch.set_num_threads(threads)


def on_jax(observations: Observations, device: str) -> AbstractContextManager[BlockKernel]:
    """Open the observations for JAX on "cpu" or "cuda"."""
    import jax

    place = jax.devices("gpu" if device == "cuda" else "cpu")[0]

    def compute(formula: Any, block: Block, *parameters: Any) -> Array:
        width = min(_power_of_two(block.n), max(1, _JAX[device] // block.slots))
        narrow = [None if values is None else values.astype(np.float32) for values in parameters]
        return np.asarray(_jitted(formula)(*jax.device_put((*fill(observations, block, width=width), *narrow), place)))

    return open_blocks(observations, device, compute, _JAX[device], _few_sizes)


@functools.cache
def _jitted(formula: Callable[..., Any]) -> Callable[..., Any]:
    import jax

    return jax.jit(formula)


def _power_of_two(n: int) -> int:
    """The smallest power of two that is at least n."""
    return 1 << (n - 1).bit_length()


def _few_sizes(n: int) -> int:
    """The smallest power of two, or three quarters of one, that is at least n."""
    power = _power_of_two(n)
    return power * 3 // 4 if n <= power * 3 // 4 else power
