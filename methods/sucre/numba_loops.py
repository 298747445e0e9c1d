"""The passes as loops that numba compiles: the fastest on a CPU, with the least memory.

The loops read the arrays of `Observations`, whatever their type, in memory or on disk. They work a few hundred pixels
at a time. A first sweep over the slots computes both exponentials of each observation, which are still in the cache
when the second sweep needs them. Slots are the outer loop and pixels the inner one, so every inner loop walks along
contiguous arrays and compiles to vector instructions. The exponential is a polynomial for the same reason: calling the
C library's for each number takes several times as long as all the rest.

float32 inside a slot of a block, float64 across. Threads work shares of the pixels, and the shares are added up in
their order, so that equal runs give equal results. numba's own parallel loops are avoided: its default threads abort
the process when two callers use them at once.

This module imports numba; only passes.opened imports this module.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numba
import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.machine.compute import compile_loop
from sucre_bench.methods.sucre.model import LEAST
from sucre_bench.methods.sucre.passes import DARKEST, WALL, Block, colours
from sucre_bench.multiview.observations import Observations

# Sums may be reordered and products fused, else no sum becomes vector instructions; NaN and infinity keep their
# meaning, so that a water out of the range of numbers is seen as such.
_FAST = {"reassoc", "contract", "nsz", "arcp"}
loop = partial(compile_loop, fastmath=_FAST)

# Always inlined. A standalone function can be compiled several times with different rounding, and the load order would
# decide which one runs.
inline = numba.njit(forceinline=True, error_model="numpy", fastmath=_FAST)

# observations in a block: its six arrays take 200 kB, a part of a core's L2 cache
_PLACES = 1 << 13
SHARE = 1 << 20  # observations in a share of a thread, some milliseconds

LOG2_E = 1 / np.log(2)
_ONE = np.float32(1)
_ZERO = np.float32(0)
_HALF = np.float32(0.5)
_WALL = np.float32(WALL)
_LEAST = np.float32(LEAST)
# Powers of two short of the limits of float32, also when they are squared: no light is 2^-60, not 0, whose colour is
# 0 / 0.
_LOWEST = np.float32(DARKEST)
_HIGHEST = np.float32(125)
_LIFT = np.float32(256)  # makes exponents positive, where cutting off is rounding down
# of float32's layout
_BIAS = np.int32(127)
_MANTISSA = np.int32(23)

# (2^f - 1) / f for |f| <= 1/2, f the polynomial's argument: minimax, 2^f within 2e-9 before rounding.
_C1 = np.float32(0.6931471824645996)
_C2 = np.float32(0.24022650718688965)
_C3 = np.float32(0.055503278970718384)
_C4 = np.float32(0.009618005715310574)
_C5 = np.float32(0.001340028247795999)
_C6 = np.float32(0.0001547588617540896)


@inline
def power_minus_1(x: Any) -> Any:
    """Return 2^x - 1 in float32, accurate for small x as well: 2^x = 2^k 2^f with x = k + f, |f| <= 1/2."""
    x = _LOWEST if x < _LOWEST else x
    x = _HIGHEST if x > _HIGHEST else x
    k = np.int32(x + _LIFT + _HALF) - np.int32(_LIFT)
    f = x - np.float32(k)
    scale = np.int32((np.int32(k) + _BIAS) << _MANTISSA).view(np.float32)
    rest = f * (_C1 + f * (_C2 + f * (_C3 + f * (_C4 + f * (_C5 + f * _C6)))))
    return scale * rest + (scale - _ONE)


@inline
def _first_sweep(
    z: Any, I: Any, s: Any, scale: Any, B: Any, rates: Any, kept: Any, sums: Any
) -> None:
    """Compute the terms of a slot's observations in one water, and add them to their pixels' sums.

    z, I, s: (n,) distance, stored colour, root of the weight; rates: -beta log2(e), -gamma log2(e); kept: (4, n') x
    = s a, d = s D_B, g = s D_gamma / B, y = s I - B d; sums: (6, n'') of x times x, y, d, z x, g; the last row is
    for `_project`.
    """
    x, d, g, y = kept[0], kept[1], kept[2], kept[3]
    A, S, C_B, Z, C_gamma = sums[0], sums[1], sums[2], sums[3], sums[4]
    beta, gamma = rates
    for i in range(len(z)):
        x_i = s[i] * (power_minus_1(beta * z[i]) + _ONE)
        d_i = s[i] * -power_minus_1(gamma * z[i])
        g_i = z[i] * (s[i] - d_i)
        y_i = s[i] * (scale * np.float32(I[i])) - B * d_i
        x[i], d[i], g[i], y[i] = x_i, d_i, g_i, y_i
        A[i] += x_i * x_i
        S[i] += x_i * y_i
        C_B[i] += x_i * d_i
        Z[i] += x_i * x_i * z[i]
        C_gamma[i] += x_i * g_i


@inline
def _project(z: Any, kept: Any, sums: Any, bent: Any) -> None:
    """Turn what a slot kept into columns: D'_B, D'_beta, D'_gamma / B, r. The sums over A are by now J and means.

    bent: see Eliminated.bent; what a slot adds by itself. sums[5]: (n,) what it adds to the slope of each pixel.
    """
    x, d, g, y = kept[0], kept[1], kept[2], kept[3]
    J, mean_d, mean_z, mean_g, slope = sums[1], sums[2], sums[3], sums[4], sums[5]
    beta_beta = B_gamma = gamma_gamma = _ZERO
    for i in range(len(z)):
        x_i, g_i = x[i], g[i]
        far = z[i] - mean_z[i]
        y[i] -= x_i * J[i]
        slope_i = far * x_i * y[i]
        slope[i] += slope_i
        beta_beta -= J[i] * far * slope_i
        B_gamma -= g_i * y[i]
        gamma_gamma += z[i] * g_i * y[i]
        x[i] = d[i] - x_i * mean_d[i]
        d[i] = -J[i] * x_i * far
        g[i] -= x_i * mean_g[i]
    bent[1, 1] += beta_beta
    bent[0, 2] += B_gamma
    bent[2, 2] += gamma_gamma


@inline
def _add_slopes(sums: Any, n: int, bent: Any) -> None:
    """Add what the slopes of n pixels tell of `bent` together."""
    A, mean_d, mean_g, slope = sums[0], sums[2], sums[4], sums[5]
    B_beta = beta_beta = gamma_beta = _ZERO
    for i in range(n):
        B_beta -= mean_d[i] * slope[i]
        beta_beta -= slope[i] * slope[i] / max(A[i], _LEAST)
        gamma_beta -= mean_g[i] * slope[i]
    bent[0, 1] += B_beta
    bent[1, 1] += beta_beta
    bent[1, 2] += gamma_beta


@inline
def _add_products(columns: Any, n: int, total: Any) -> None:
    """Add the products of four columns of n numbers to the upper triangle of total (4, 4) float64."""
    for j in range(4):
        for k in range(j, 4):
            product = _ZERO
            for i in range(n):
                product += columns[j, i] * columns[k, i]
            total[j, k] += product


@inline
def _sum_block(
    store: Any, c: int, start: int, n: int, water: Any, roots: Any, kept: Any, sums: Any
) -> int:
    """Sweep the slots of n pixels first, then divide the sums by A; return how many slots there were."""
    distance, colour, weight, starts, scale = store
    log2_e = np.float32(LOG2_E)
    rates = (-water[1] * log2_e, -water[2] * log2_e)
    for row in range(6):
        for i in range(n):
            sums[row, i] = _ZERO
    slots = 0
    for k in range(len(starts) - 1):
        n_k = min(n, starts[k + 1] - starts[k] - start)
        if n_k <= 0:
            break
        slots = k + 1
        part = slice(starts[k] + start, starts[k] + start + n_k)
        if len(weight):
            of_channel = weight[min(c, len(weight) - 1)]
            for i in range(n_k):
                roots[i] = np.sqrt(of_channel[part.start + i])
        _first_sweep(
            distance[part],
            colour[c][part],
            roots,
            scale,
            water[0],
            rates,
            kept[k % len(kept)],
            sums,
        )
    for row in range(1, 5):
        for i in range(n):
            sums[row, i] /= max(sums[0, i], _LEAST)
    return slots


@inline
def _hold(first: Any, n: int, sums: Any, margin: Any, total: Any) -> None:
    """Add the residual of every pixel whose sqrt(A) J lies below -margin; its columns replace the first slot's."""
    for i in range(n):
        root = np.sqrt(sums[0, i])
        J = sums[1, i]
        short = root * J + margin
        held = short < _ZERO
        first[0, i] = -_WALL * sums[2, i] * root if held else _ZERO
        first[1, i] = -_WALL * sums[5, i] / root if held else _ZERO
        first[2, i] = -_WALL * sums[4, i] * root if held else _ZERO
        first[3, i] = -_WALL * short if held else _ZERO
    _add_products(first, n, total)


@loop
def _share_products(store: Any, share: Any, size: int, water: Any, margin: Any) -> Any:
    """The products (3, 4, 7) of a share's pixels (start, stop, slots), `size` at a time; see passes.products."""
    distance, _, _, starts, _ = store
    start, stop, slots = share
    kept, sums = (
        np.empty((slots, 4, size), dtype=np.float32),
        np.empty((6, size), dtype=np.float32),
    )
    roots = np.ones(size, dtype=np.float32)
    total = np.zeros((3, 4, 7))
    for begin in range(start, stop, size):
        n = min(size, stop - begin)
        for c in range(3):
            used = _sum_block(store, c, begin, n, water[c], roots, kept, sums)
            for k in range(used):
                n_k = min(n, starts[k + 1] - starts[k] - begin)
                part = slice(starts[k] + begin, starts[k] + begin + n_k)
                _project(distance[part], kept[k], sums, total[c, :, 4:])
                _add_products(kept[k], n_k, total[c])
            _add_slopes(sums, n, total[c, :, 4:])
            if len(margin):
                _hold(kept[0], n, sums, margin[c], total[c])
    for c in range(3):
        for i in range(4):
            total[c, i, 2] *= water[c, 0]  # the column of D_gamma is without its factor B
            total[c, 2, i] *= water[c, 0]
            for j in range(i):
                total[c, i, j] = total[c, j, i]
        total[c, 1, 6] *= water[c, 0]
        total[c, 2, 6] *= water[c, 0]
        for i in range(3):
            for j in range(i):
                total[c, i, 4 + j] = total[c, j, 4 + i]
    return total


@loop
def _share_colours(
    store: Any, share: Any, size: int, water: Any, noise: Any, covariance: Any, found: Any
) -> None:
    """Write J and its deviation, (2, 3, n), of a share's pixels; see passes.colours."""
    start, stop, _ = share
    kept, sums = np.empty((1, 4, size), dtype=np.float32), np.empty((6, size), dtype=np.float32)
    roots = np.ones(size, dtype=np.float32)
    for begin in range(start, stop, size):
        n = min(size, stop - begin)
        for c in range(3):
            _sum_block(store, c, begin, n, water[c], roots, kept, sums)
            V, B = covariance[c], water[c, 0]
            for i in range(n):
                J_i = sums[1, i]
                p = sums[2, i]
                q = -J_i * sums[3, i]
                u = B * sums[4, i]
                of_water = p * (V[0, 0] * p + V[0, 1] * q + V[0, 2] * u)
                of_water += q * (V[1, 0] * p + V[1, 1] * q + V[1, 2] * u)
                of_water += u * (V[2, 0] * p + V[2, 1] * q + V[2, 2] * u)
                found[0, c, begin - start + i] = J_i
                found[1, c, begin - start + i] = np.sqrt(
                    noise[c] * noise[c] / sums[0, i] + of_water
                )


def store_of(observations: Observations) -> tuple[Any, ...]:
    """Return the arrays of observations that the loops read."""
    weight = (
        np.empty((0, 0), dtype=np.float32)
        if observations.weight is None
        else np.atleast_2d(observations.weight)
    )
    arrays = (observations.distance, observations.colour, weight, observations.starts)
    return (*map(np.ascontiguousarray, arrays), np.float32(observations.scale))


def compiled(observations: Observations) -> Callable[..., Array]:
    """Return what computes a formula for a block with these loops."""
    store = store_of(observations)

    def compute(formula: Any, block: Block, rows: Array, *parameters: Array | None) -> Array:
        share = (block.start, block.start + block.n, block.slots)
        size = min(max(64, _PLACES // block.slots), 1024)
        water, *others = map(_channel_first, (rows, *parameters))
        if formula is colours:
            found = np.empty((2, 3, block.n), dtype=np.float32)
            noise, covariance = others
            _share_colours(store, share, size, water, noise, covariance, found)
            return found
        total: Array = _share_products(store, share, size, water, others[0])
        return total

    return compute


def _channel_first(values: Array | None) -> Array:
    """Return parameters (..., 3, 1, 1) as (3, ...) float32; none of None."""
    if values is None:
        return np.empty(0, dtype=np.float32)
    return np.ascontiguousarray(np.moveaxis(values[..., 0, 0], -1, 0), dtype=np.float32)
