"""The formulas of both passes on one block of observations, written once for every array library.

A block is a run of pixels and their observations as rectangles (K, n): K slots, n pixels. The pixels are sorted by
how many observations they have, so few places stay empty; empty places have weight 0.

Cancellation. D' is formed before it is squared: H = sum D^T D - C^T C / A in float32 would lose all digits where
distances are alike (relative error 9 at 3 to 3.3 m, against 1e-3). For beta it simplifies to

    D'_beta = -J a (z - z_mean),    z_mean = sum a^2 z / sum a^2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.methods.sucre.model import transmission, veil
from sucre_bench.multiview.observations import Observations

# How much more a colour below zero counts than a residual of that size: enough to keep all but a few above.
WALL = 10.0

# Transmissions end at two to this power: less light is none, and its square is still a number in float32.
DARKEST = -60.0


@dataclass(frozen=True, slots=True)
class Block:
    """Pixels start to start + n of the observations, with up to `slots` observations each."""

    start: int
    n: int
    slots: int


def blocks(
    observations: Observations, elements: int, *, stop: int | None = None, slots: Callable[[int], int] = int
) -> list[Block]:
    """Cut pixels 0 to stop into blocks of at most so many places (slots x pixels), at least one pixel each.

    slots: how many to give a block that needs so many.
    """
    stop = len(observations.pixels) if stop is None else stop
    cut, start = [], 0
    while start < stop:
        height = slots(int(observations.counts[start]))
        n = min(max(1, elements // height), stop - start)
        cut.append(Block(start, n, height))
        start += n
    return cut


def fill(
    observations: Observations, block: Block, dtype: Any = np.float32, *, width: int | None = None
) -> tuple[Array, Array, Array]:
    """Return distance (K, n), intensity (3, K, n) and weight (K, n) of a block's observations, 0 in empty places.

    width: of the rectangles, n by default. Pixels beyond n have one observation of intensity 0 at distance 0. Any water
    explains it with J = 0, so it adds nothing, and nothing is divided by 0.
    """
    width = block.n if width is None else width
    z = np.zeros((block.slots, width), dtype=dtype)
    I = np.zeros((3, block.slots, width), dtype=dtype)  # noqa: E741
    w = np.zeros((block.slots, width), dtype=dtype)
    w[0, block.n :] = 1
    scale = dtype(observations.scale)
    for k, (n, part) in enumerate(observations.slots(block.start, block.start + block.n)):
        z[k, :n] = observations.distance[part]
        np.multiply(observations.colour[:, part], scale, out=I[:, k, :n], casting="unsafe")
        w[k, :n] = 1 if observations.weight is None else observations.weight[part]
    return z, I, w


def _light(z: Any, beta: Any) -> Any:
    return transmission((beta * z).clip(max=-DARKEST * math.log(2)), 1.0)


def colours(
    z: Any,
    I: Any,  # noqa: E741
    s: Any,
    water: Any,
    noise: Any,
    covariance: Any,
) -> tuple[Any, Any]:
    """Return the best J (n,) of one channel and its standard deviation (n,).

    z, I, s: (K, n), s the roots of the weights; water: its B, beta, gamma; noise: standard deviation of I; covariance:
    (3, 3) of B, beta, gamma. The variance is noise^2 / A of the observations, A = sum w a^2, and c^T covariance c of
    the water, c = (sum w a D) / A.
    """
    B, beta, gamma = water
    x, d = s * _light(z, beta), s * veil(z, 1, gamma)
    xx = x * x
    A = xx.sum(0)
    J = (x * (s * I - B * d)).sum(0) / A
    c = ((x * d).sum(0) / A, -J * (xx * z).sum(0) / A, B * (x * z * (s - d)).sum(0) / A)
    variance = noise**2 / A
    for i in range(3):
        for j in range(3):
            variance = variance + covariance[i][j] * c[i] * c[j]
    return J, variance**0.5


def at_once(columns: Any) -> Any:
    """Return columns (4, N) times their transpose, on a processor."""
    return columns @ columns.T


def row_by_row(columns: Any, stack: Any, **precision: Any) -> Any:
    """Return columns (4, N) times their transpose, on a GPU.

    There a matrix product of rows this long adds each result in one chain of float32. On 1.8 million observations that
    cost 1 % of a veiling light, while sums are made in trees: with them a whole water is within 1e-6 of float64's.
    """
    return stack([(columns * row).sum(-1, **precision) for row in columns])


def products(
    z: Any,
    I: Any,  # noqa: E741
    s: Any,
    water: Any,
    margin: Any,
    stack: Any,
    squares: Callable[[Any], Any],
) -> Any:
    """Return the products (4, 4) of one channel's columns (D'_B, D'_beta, D'_gamma, r) over a block.

    z, I, s: (K, n), s the roots of the weights; water: its B, beta, gamma; stack: joins arrays of the library along a
    new first axis; squares: returns columns (4, N) times their transpose, see `at_once` and `row_by_row`. margin: the
    colours are held above zero, up to noise: a pixel whose sqrt(A) J lies below -margin adds the residual
    WALL (sqrt(A) J + margin), the way it would need to get there; margin is in the unit of I. None: free.
    """
    B, beta, gamma = water
    x, d = s * _light(z, beta), s * veil(z, 1, gamma)  # a and D_B, weighted
    y, g = s * I - B * d, B * z * (s - d)
    xx = x * x
    A = xx.sum(0)
    J, z_mean = (x * y).sum(0) / A, (xx * z).sum(0) / A
    mean_B, mean_gamma = (x * d).sum(0) / A, (x * g).sum(0) / A
    r = y - x * J
    columns = stack([d - x * mean_B, x * J * (z_mean - z), g - x * mean_gamma, r]).reshape(4, -1)
    total = squares(columns)
    if margin is None:
        return total
    root = A**0.5
    short = root * J + margin  # of zero, where negative
    slope = stack([-root * mean_B, -(x * z * r).sum(0) / root, -root * mean_gamma, -short])
    slope = slope * (WALL * (short < 0))
    return total + squares(slope)
