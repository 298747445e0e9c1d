"""The two passes over all observations that the solvers need, for several array libraries.

A backend is a `Kernel`: these two functions and nothing else. Solving, sampling and judging are the same for all.
"""

from __future__ import annotations

import os
from contextlib import AbstractContextManager
from typing import Literal, Protocol

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError
from sucre_bench.machine.cores import Device
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.normal_equations import ReducedSystem
from sucre_bench.multiview.observations import Observations

Backend = Literal["auto", "numba", "torch", "jax", "numpy"]


class Kernel(Protocol):
    """Sums over the observations it was opened with."""

    @property
    def device(self) -> str:
        """Where it computes: "cpu" or "cuda"."""
        ...

    def system(self, water: WaterParameters, margin: Array | None = None) -> ReducedSystem:
        """Return the reduced problem around a water, over the pixels that inform it.

        Without a margin these are the pixels seen more than once. With a margin (3,), an intensity for each channel,
        they are all pixels, and colours are held above zero up to it (see kernels/formulas.py, `products`).
        """
        ...

    def colours(self, water: WaterParameters, noise: Array, covariance: Array) -> tuple[Array, Array]:
        """Return J (3, P) float32 and its standard deviation (3, P) float32, in the order of `Observations.pixels`.

        noise: (3,) standard deviation of I; covariance: (3, 3, 3) of each channel's B, beta, gamma.
        """
        ...


def opened(observations: Observations, backend: Backend, device: Device) -> AbstractContextManager[Kernel]:
    """Make the observations ready for a backend, for the time of a `with` block.

    Raises InputError when there is no such device.
    """
    backend, place = backend_for(backend, device)
    if backend == "torch":
        from sucre_bench.methods.sucre.kernels.on_torch import on_torch

        return on_torch(observations, place)
    if backend == "jax":
        from sucre_bench.methods.sucre.kernels.on_jax import on_jax

        return on_jax(observations, place)
    if backend == "numba":
        from sucre_bench.methods.sucre.kernels.compiled import compiled

        return compiled(observations)
    from sucre_bench.methods.sucre.kernels.on_numpy import on_numpy

    return on_numpy(observations)


def backend_for(backend: Backend, device: Device) -> tuple[Literal["numba", "torch", "jax", "numpy"], str]:
    """Return which backend computes where. auto: the compiled loops, unless a GPU is asked for.

    On an H100, PyTorch and JAX took twice as long as the loops did on the 16 processors beside it
    (benchmarks/devices.py): moving the observations takes longer than the sums.
    """
    if device == "cuda" and backend in ("numba", "numpy"):
        raise InputError(f"backend={backend} computes on the CPU only; use device=auto, or backend=torch or jax")
    if backend == "jax":
        return "jax", _jax_device(device)
    if backend == "torch" or device == "cuda":
        return "torch", _torch_device(device)
    return "numpy" if backend == "numpy" else "numba", "cpu"


def _torch_device(device: Device) -> str:
    import torch

    if device == "cuda" and not torch.cuda.is_available():
        raise InputError("device=cuda: PyTorch sees no CUDA GPU; use device=auto or device=cpu")
    return "cuda" if device != "cpu" and torch.cuda.is_available() else "cpu"


def _jax_device(device: Device) -> str:
    has_gpu = _jax_sees_gpu()
    if device == "cuda" and not has_gpu:
        raise InputError("device=cuda: JAX sees no GPU; use device=auto or device=cpu, or backend=torch")
    return "cuda" if device != "cpu" and has_gpu else "cpu"


def _jax_sees_gpu() -> bool:
    """Whether JAX sees a GPU. When it first looks, JAX would take 3/4 of the GPU's memory from all other processes."""
    import jax

    given = os.environ.get(_PREALLOCATE)
    os.environ[_PREALLOCATE] = "false" if given is None else given
    try:
        return bool(jax.default_backend() == "gpu")
    finally:
        if given is None:
            del os.environ[_PREALLOCATE]


_PREALLOCATE = "XLA_PYTHON_CLIENT_PREALLOCATE"
