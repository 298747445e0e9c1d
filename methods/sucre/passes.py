"""The two passes over all observations that the solvers need: the normal equations of the water, and all colours.

A backend computes these two for a block of pixels, and nothing else. Solving, sampling and judging are the same for
all. numba_loops.py has the passes as compiled loops. The formulas below are written once for every library that
computes with rectangles (NumPy, PyTorch, JAX): a block is a run of pixels and their observations as rectangles (K, n),
K slots and n pixels. The pixels are sorted by how many observations they have, so few places stay empty; empty places
have weight 0.

Cancellation. D' is formed before it is squared: H = sum D^T D - C^T C / A in float32 would lose all digits where
distances are alike (relative error 9 at 3 to 3.3 m, against 1e-3). For beta it simplifies to

    D'_beta = -J a (z - z_mean),    z_mean = sum a^2 z / sum a^2.
"""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from itertools import chain
from typing import Any, Literal

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError
from sucre_bench.machine.compute import Device, usable_cores
from sucre_bench.methods.sucre.model import (
    LEAST,
    ReducedSystem,
    WaterParameters,
    eliminated,
    library_of,
    transmission,
    veil,
)
from sucre_bench.multiview.observations import Observations

Backend = Literal["auto", "numba", "torch", "jax"]

# How much more a colour below zero counts than a residual of that size: enough to keep all but a few above.
WALL = 10.0

# Transmissions end at two to this power: less light is none, and its square is still a number in float32.
DARKEST = -60.0


def opened(
    observations: Observations, backend: Backend | Literal["numpy"], device: Device
) -> AbstractContextManager[Kernel]:
    """Make the observations ready for a backend, for the time of a `with` block.

    backend "numpy" computes in float64: slow, and the reference for the others. Raises InputError when there is no
    such device.
    """
    if backend == "numpy":
        return nullcontext(Kernel(observations, "cpu", in_numpy(observations), _NUMPY))
    library, place = backend_for(backend, device)
    if library == "numba":
        from sucre_bench.methods.sucre.numba_loops import SHARE, compiled

        return nullcontext(Kernel(observations, "cpu", compiled(observations), SHARE))
    return (
        on_torch(observations, place)
        if library == "torch"
        else nullcontext(on_jax(observations, place))
    )


def backend_for(
    backend: Backend, device: Device
) -> tuple[Literal["numba", "torch", "jax"], Literal["cpu", "cuda"]]:
    """Return which backend computes where. auto: the compiled loops, unless a GPU is asked for.

    On an H100, PyTorch and JAX took twice as long as the loops did on the 16 processors beside it
    (benchmarks/devices.py): moving the observations takes longer than the sums.
    """
    if device == "cuda" and backend == "numba":
        raise InputError(
            "method.backend=numba computes on the CPU only",
            remedy="use method.device=auto, or method.backend=torch",
        )
    if backend in ("auto", "numba") and device != "cuda":
        return "numba", "cpu"
    if backend == "jax":
        has_gpu = _jax_sees_gpu()
    else:
        import torch

        has_gpu = torch.cuda.is_available()
    library: Literal["jax", "torch"] = "jax" if backend == "jax" else "torch"
    if device == "cuda" and not has_gpu:
        device_option = "method.device"
        raise InputError(
            f"{library} sees no GPU", f"{device_option}=cuda", f"use {device_option}=auto"
        )
    return library, "cuda" if device != "cpu" and has_gpu else "cpu"


def _jax_sees_gpu() -> bool:
    """Whether JAX sees a GPU. When it first looks, JAX would take 3/4 of the GPU's memory from all other processes."""
    import jax

    name = "XLA_PYTHON_CLIENT_PREALLOCATE"
    is_given = name in os.environ
    os.environ.setdefault(name, "false")
    try:
        return bool(jax.default_backend() == "gpu")
    finally:
        if not is_given:
            del os.environ[name]


@dataclass(frozen=True, slots=True)
class Block:
    """Pixels start to start + n of the observations, with up to `slots` observations each."""

    start: int
    n: int
    slots: int


def blocks(
    observations: Observations,
    elements: int,
    *,
    stop: int | None = None,
    slots: Callable[[int], int] = int,
) -> list[Block]:
    """Cut pixels 0 to stop into blocks of at most so many places (slots x pixels), at least one pixel each.

    slots: how many to give a block that needs so many.
    """
    stop = len(observations.pixels) if stop is None else stop
    cut = []
    start = 0
    while start < stop:
        height = slots(int(observations.counts[start]))
        n = min(max(1, elements // height), stop - start)
        cut.append(Block(start, n, height))
        start += n
    return cut


def fill(
    observations: Observations,
    block: Block,
    dtype: Any = np.float32,
    *,
    width: int | None = None,
) -> tuple[Array, Array, Array]:
    """Return distance (K, n), intensity (3, K, n) and weight of a block's observations, 0 in empty places.

    The weight is (K, n), or (3, K, n) if each channel has its own. width: of the rectangles, n by default.
    """
    shape = (block.slots, block.n if width is None else width)
    weight = observations.weight
    z, I = np.zeros(shape, dtype=dtype), np.zeros((3, *shape), dtype=dtype)
    w = np.zeros(shape if weight is None else (*weight.shape[:-1], *shape), dtype=dtype)
    scale = dtype(observations.scale)
    for k, (n, part) in enumerate(observations.slots(block.start, block.start + block.n)):
        z[k, :n] = observations.distance[part]
        np.multiply(observations.colour[:, part], scale, out=I[:, k, :n], casting="unsafe")
        w[..., k, :n] = 1 if weight is None else weight[..., part]
    return z, I, w


@dataclass(frozen=True, slots=True, eq=False)
class Eliminated:
    """A block after its colours are eliminated. Arrays (3, K, n), or (3, 1, n) for sums over the slots."""

    z: Any
    """Distance."""

    s: Any
    """Root of the weight."""

    x: Any
    """The product s a."""

    d: Any
    """The product s D_B."""

    g: Any
    """The product s D_gamma."""

    A: Any
    """The sum of x^2."""

    J: Any
    """The colour, sum of x y / A, where y = s (I - b)."""

    r: Any
    """The residual, y - x J."""

    @staticmethod
    def of(z: Any, I: Any, w: Any, water: Any) -> Eliminated:
        B, beta, gamma = water
        s = w**0.5
        x = s * transmission((beta * z).clip(max=-DARKEST * math.log(2)), 1.0)
        d = s * veil(z, 1, gamma)
        return Eliminated(z, s, x, d, B * z * (s - d), *eliminated(x, s * I - B * d, 1))

    def mean(self, values: Any) -> Any:
        """Return sum x values / A."""
        return (self.x * values).sum(1, keepdims=True) / self.A.clip(min=LEAST)

    @property
    def far(self) -> Any:
        """The distance less z_mean, (3, K, n)."""
        return self.z - self.mean(self.x * self.z)

    @property
    def columns(self) -> Any:
        """D'_B, D'_beta, D'_gamma and r: (3, 4, K, n)."""
        x = self.x
        of_beta = -self.x * self.J * self.far
        D = [self.d - x * self.mean(self.d), of_beta, self.g - x * self.mean(self.g), self.r]
        return library_of(x).stack(D, 1)

    @property
    def slope(self) -> Any:
        """Sum z x r, (3, 1, n): with z less its mean the same, since sum x r is 0."""
        return (self.far * self.x * self.r).sum(1, keepdims=True)

    @property
    def bent(self) -> Any:
        """What r adds to half the second derivatives by B, beta and gamma, and a row of 0: (3, 4, 3)."""
        far, slope = self.far, self.slope
        curve = (self.J * far * far * self.x * self.r).sum(1, keepdims=True)
        of_pixels = (
            self.mean(self.d) * slope,
            curve + slope * slope / self.A.clip(min=LEAST),
            self.mean(self.g) * slope,
        )
        B_beta, beta_beta, gamma_beta = (-each.sum((1, 2)) for each in of_pixels)
        B_gamma = -(self.z * (self.s - self.d) * self.r).sum((1, 2))
        gamma_gamma = (self.z * self.g * self.r).sum((1, 2))
        none = library_of(B_gamma).zeros_like(B_gamma)
        rows = (
            (none, B_beta, B_gamma),
            (B_beta, beta_beta, gamma_beta),
            (B_gamma, gamma_beta, gamma_gamma),
            (none, none, none),
        )
        library = library_of(none)
        return library.stack([library.stack(row, -1) for row in rows], 1)


def colours(z: Any, I: Any, w: Any, water: Any, noise: Any, covariance: Any) -> Any:
    """Return the best J and its standard deviation of a block, (2, 3, n).

    z, I, w: see `fill`; water: B, beta, gamma, (3, 1, 1) each; noise: (3, 1, 1) standard deviation of I; covariance:
    (3, 3, 3, 1, 1), of B, beta, gamma, then channels. The variance is noise^2 / A of the observations, A = sum w a^2,
    and c^T covariance c of the water, c = (sum w a D) / A.
    """
    block = Eliminated.of(z, I, w, water)
    c = block.mean(block.d), -block.J * block.mean(block.x * z), block.mean(block.g)
    variance = noise**2 / block.A + sum(
        covariance[i, j] * c[i] * c[j] for i in range(3) for j in range(3)
    )
    return library_of(z).stack([block.J, variance**0.5])[:, :, 0]


def products(z: Any, I: Any, w: Any, water: Any, margin: Any, *, on_gpu: bool = False) -> Any:
    """Return the products (3, 4, 4) of each channel's columns (D'_B, D'_beta, D'_gamma, r) over a block, then `bent`.

    Both are in one array, (3, 4, 7). Of what a margin adds, the second derivatives are left out.

    z, I, w: see `fill`; water: B, beta, gamma, (3, 1, 1) each. margin: (3, 1, 1), or None for free colours. With a
    margin, colours are held above zero, up to noise: a pixel whose sqrt(A) J lies below -margin adds the residual
    WALL (sqrt(A) J + margin), the way it would need to get there; margin is in the unit of I.
    """
    block, library = Eliminated.of(z, I, w, water), library_of(z)
    total = _squares(block.columns.reshape(3, 4, -1), on_gpu)
    if margin is None:
        return library.concatenate([total, block.bent], -1)
    root = block.A.clip(min=LEAST) ** 0.5
    short = root * block.J + margin  # of zero, where negative
    of_beta = -block.slope / root
    slope = [-root * block.mean(block.d), of_beta, -root * block.mean(block.g), -short]
    held = library.stack(slope, 1)[:, :, 0] * (WALL * (short < 0))
    return library.concatenate([total + _squares(held, on_gpu), block.bent], -1)


products_on_gpu = functools.partial(products, on_gpu=True)


def _squares(columns: Any, on_gpu: bool) -> Any:
    """Return columns (3, 4, N) times their transposes.

    On a GPU a matrix product of rows this long adds each result in one chain of float32. On 1.8 million observations
    that cost 1 % of a veiling light, while sums are made in trees: with them a whole water is within 1e-6 of float64's.
    """
    if not on_gpu:
        return columns @ columns.swapaxes(1, 2)
    library = library_of(columns)
    wide = {"dtype": library.float64} if library.__name__ == "torch" else {}
    return library.stack(
        [(columns * columns[:, k : k + 1]).sum(-1, **wide) for k in range(4)], 1
    )


@dataclass(frozen=True, slots=True, eq=False)
class Kernel:
    """The passes over the observations it was opened with, as sums over blocks of at most `places` places.

    Several blocks are computed at a time on the CPU, block after block on a GPU. Results come in the order of the
    blocks, whatever thread made them, so that equal runs give equal sums.
    """

    observations: Observations

    device: str
    """Where it computes, "cpu" or "cuda"."""

    compute: Callable[..., Array]
    """Returns the result of a formula (`products`, `colours`) for a block, float64 or float32, from arrays of
    parameters. Raises MemoryError where a GPU lacks the memory for it."""

    places: int

    slots: Callable[[int], int] = int
    """How many to give a block that needs so many."""

    def system(self, water: WaterParameters, margin: Array | None = None) -> ReducedSystem:
        """Return the reduced problem around a water, over the pixels that inform it.

        Without a margin these are the pixels seen more than once. With a margin (3,), an intensity for each channel,
        they are all pixels, and colours are held above zero up to it (see `products`).
        """
        stop = self.observations.n_repeated if margin is None else None
        formula = products_on_gpu if self.device == "cuda" else products
        parts = self._each(
            stop, formula, water, None if margin is None else _by_channel(margin)
        )
        total = sum((part for _, part in parts), np.zeros((3, 4, 7)))
        H, bent = total[:, :3, :3], total[:, :3, 4:]
        return ReducedSystem(H, total[:, :3, 3], total[:, 3, 3], H + bent)

    def colours(
        self, water: WaterParameters, noise: Array, covariance: Array
    ) -> tuple[Array, Array]:
        """Return J (3, P) float32 and its standard deviation (3, P) float32, in the order of `Observations.pixels`.

        noise: (3,) standard deviation of I; covariance: (3, 3, 3) of each channel's B, beta, gamma. Where all weights
        of a pixel are 0 in a channel, J is 0 and its deviation infinite.
        """
        found = np.empty((2, 3, len(self.observations.pixels)), dtype=np.float32)
        by_channel = _by_channel(np.moveaxis(covariance, 0, -1))
        for block, part in self._each(None, colours, water, _by_channel(noise), by_channel):
            found[:, :, block.start : block.start + block.n] = part[:, :, : block.n]
        return found[0], found[1]

    def _each(
        self, stop: int | None, formula: Any, water: WaterParameters, *parameters: Any
    ) -> Iterator[tuple[Block, Array]]:
        rows = _by_channel(water.by_channel().T)
        cut = blocks(self.observations, self.places, stop=stop, slots=self.slots)

        def work(block: Block) -> list[tuple[Block, Array]]:
            try:
                return [(block, self.compute(formula, block, rows, *parameters))]
            except MemoryError:
                if block.n == 1:
                    raise
            half = block.n // 2
            rest = Block(block.start + half, block.n - half, block.slots)
            return work(Block(block.start, half, block.slots)) + work(rest)

        if len(cut) == 1 or self.device != "cpu":
            yield from chain.from_iterable(map(work, cut))
            return
        with ThreadPoolExecutor(usable_cores()) as workers:
            yield from chain.from_iterable(workers.map(work, cut))


def _by_channel(values: Array) -> Array:
    """Return values (..., 3) as (..., 3, 1, 1), to be broadcast over rectangles (3, K, n)."""
    return np.array(values, dtype=np.float64)[..., None, None]


# -- NumPy, PyTorch and JAX ----------------------------------------------------------------------
#
# So a GPU holds one block at a time, and its memory limits only the size of a block. PyTorch and JAX compute in float32
# inside a block; sums across blocks are float64. NumPy computes in float64, the reference for the others.
#
# XLA, which compiles for JAX, compiles once for every shape. So JAX's blocks have few shapes: 1, 2, 3, 4, 6, 8, 12, 16,
# 24 ... slots, as many pixels as fill a block, and a power of two of them in the last block. JAX's own setting for
# float64 stays as it is.

# Places in a block. CPU: temporaries of 0.2 MB stay in the cache. GPU: launches dominate until a block fills it.
_NUMPY = 1 << 13
_TORCH = {"cpu": 1 << 14, "cuda": 1 << 22}
_JAX = {"cpu": 1 << 14, "cuda": 1 << 21}


def in_numpy(observations: Observations) -> Callable[..., Array]:
    """Return what computes a formula for a block with NumPy."""

    def compute(formula: Any, block: Block, *parameters: Any) -> Array:
        with np.errstate(divide="ignore"):  # by the information of pixels without any weight
            return np.asarray(formula(*fill(observations, block, np.float64), *parameters))

    return compute


@contextmanager
def on_torch(observations: Observations, device: str) -> Iterator[Kernel]:
    """Open the observations for PyTorch on "cpu" or "cuda".

    PyTorch's operations get one thread each, as several blocks run at a time. An operation on a block takes some 20 us,
    less than gathering threads for it costs, and a thread that is displaced would hold up all the others.
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
        yield Kernel(observations, device, compute, _TORCH[device])
    finally:
        torch.set_num_threads(threads)


def on_jax(observations: Observations, device: str) -> Kernel:
    """Return the passes by JAX on "cpu" or "cuda"."""
    import jax

    place = jax.devices("gpu" if device == "cuda" else "cpu")[0]

    def compute(formula: Any, block: Block, *parameters: Any) -> Array:
        width = min(1 << (block.n - 1).bit_length(), max(1, _JAX[device] // block.slots))
        narrow = [
            None if values is None else values.astype(np.float32) for values in parameters
        ]
        return np.asarray(
            _jitted(formula)(
                *jax.device_put((*fill(observations, block, width=width), *narrow), place)
            )
        )

    return Kernel(observations, device, compute, _JAX[device], _few_sizes)


@functools.cache
def _jitted(formula: Callable[..., Any]) -> Callable[..., Any]:
    import jax

    return jax.jit(formula)


def _few_sizes(n: int) -> int:
    """The smallest power of two, or three quarters of one, that is at least n."""
    power = 1 << (n - 1).bit_length()
    return power * 3 // 4 if n <= power * 3 // 4 else power
