"""Chooses which array library computes the sums, and whether on the processors or on a GPU."""

import os
from typing import Literal

from sucre_bench.errors import InputError
from sucre_bench.machine.compute import Device

Backend = Literal["auto", "numba", "torch", "jax", "numpy"]
_PREALLOCATE = "XLA_PYTHON_CLIENT_PREALLOCATE"


def backend_for(backend: Backend, device: Device) -> tuple[Literal["numba", "torch", "jax", "numpy"], str]:
    """Return which backend computes where. auto: the compiled loops, unless a GPU is asked for.

    On an H100, PyTorch and JAX took twice as long as the loops did on the 16 processors beside it
    (benchmarks/devices.py): moving the observations takes longer than the sums.
    """
    if device == "cuda" and backend in ("numba", "numpy"):
        raise InputError(
            f"method.backend={backend} computes on the CPU only; use method.device=auto, or method.backend=torch"
        )
    if backend == "jax":
        return "jax", _jax_device(device)
    if backend == "torch" or device == "cuda":
        return "torch", _torch_device(device)
    return "numpy" if backend == "numpy" else "numba", "cpu"


def _torch_device(device: Device) -> str:
    import torch

    if device == "cuda" and not torch.cuda.is_available():
        raise InputError("method.device=cuda: PyTorch sees no CUDA GPU; use method.device=auto or method.device=cpu")
    return "cuda" if device != "cpu" and torch.cuda.is_available() else "cpu"


def _jax_device(device: Device) -> str:
    has_gpu = _jax_sees_gpu()
    if device == "cuda" and not has_gpu:
        raise InputError("method.device=cuda: JAX sees no GPU; use method.device=auto, or method.backend=torch")
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
