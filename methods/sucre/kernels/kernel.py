"""What a backend is, and which file has it: two passes over all observations, for several array libraries.

A backend is a `Kernel`: these two functions and nothing else. Solving, sampling and judging are the same for all.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Protocol

from sucre_bench.arrays import Array
from sucre_bench.machine.compute import Device
from sucre_bench.methods.sucre.kernels.choose_backend import Backend, backend_for
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.normal_equations import ReducedSystem
from sucre_bench.multiview.observations import Observations


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
