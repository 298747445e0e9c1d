"""Adam's steps on a CPU, as loops that numba compiles: one sweep over the observations evaluates eq. 7 and moves J.

A colour decides no other colour's gradient, so a sweep moves it as soon as its own gradient is whole.

This module imports numba; only adam.py imports this module.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.machine.compute import usable_cores
from sucre_bench.machine.progress import track
from sucre_bench.methods.sucre.adam import MEAN, PROGRESS, SQUARE, Descent, Steps
from sucre_bench.methods.sucre.numba_loops import (
    LOG2_E,
    SHARE,
    inline,
    loop,
    power_minus_1,
    store_of,
)
from sucre_bench.methods.sucre.passes import Block, blocks
from sucre_bench.multiview.observations import Observations

# How much a step keeps of Adam's means, and what is new in them.
_MEAN = np.float32(MEAN)
_SQUARE = np.float32(SQUARE)
_TO_MEAN = np.float32(1 - MEAN)
_TO_SQUARE = np.float32(1 - SQUARE)

# Pixels that are worked on at once.
_PX = 1024


@inline
def _add_slot(z: Any, I: Any, scale: Any, J: Any, water: Any, slope: Any, total: Any) -> None:
    """Add what a slot's observations say: to dE/dJ, and to the sums of r times r, D_B, D_beta and D_gamma.

    z, I: (n,) distance, stored colour; J, slope: (n,) of their pixels; total: (4,) float64.
    """
    B = water[0]
    beta = -water[1] * np.float32(LOG2_E)
    gamma = -water[2] * np.float32(LOG2_E)
    rr = np.float32(0)
    r_B = np.float32(0)
    r_beta = np.float32(0)
    r_gamma = np.float32(0)
    for i in range(len(z)):
        a = power_minus_1(beta * z[i]) + np.float32(1)
        D_B = -power_minus_1(gamma * z[i])
        r = scale * np.float32(I[i]) - J[i] * a - B * D_B
        slope[i] -= np.float32(2) * r * a
        rr += r * r
        r_B += r * D_B
        r_beta -= r * z[i] * J[i] * a
        r_gamma += r * z[i] * (np.float32(1) - D_B)
    total[0] += rr
    total[1] += r_B
    total[2] += r_beta
    total[3] += B * r_gamma


@inline
def _move(J: Any, means: Any, squares: Any, slope: Any, rate: Any, root: Any, eps: Any) -> None:
    """Take Adam's step of some colours (n,)."""
    for i in range(len(J)):
        means[i] = _MEAN * means[i] + _TO_MEAN * slope[i]
        squares[i] = _SQUARE * squares[i] + _TO_SQUARE * slope[i] * slope[i]
        J[i] -= rate * means[i] / (np.sqrt(squares[i]) / root + eps)


@loop
def _swept(store: Any, share: Any, water: Any, colours: Any, step: Any) -> Any:
    """Return the sums (3, 4) of a share's pixels, and move their colours.

    colours: J and its means and squares, (3, 3, P); step: its rate, the root of the squares' correction, and eps; a
    rate of 0 moves nothing.
    """
    distance, colour, _, starts, scale = store
    start, stop = share
    rate, root, eps = step
    slope = np.empty(_PX, dtype=np.float32)
    total = np.zeros((3, 4))
    for begin in range(start, stop, _PX):
        n = min(_PX, stop - begin)
        for c in range(3):
            J = colours[0, c][begin : begin + n]
            means = colours[1, c][begin : begin + n]
            squares = colours[2, c][begin : begin + n]
            for i in range(n):
                slope[i] = np.float32(0)
            for k in range(len(starts) - 1):
                n_k = min(n, starts[k + 1] - starts[k] - begin)
                if n_k <= 0:
                    break
                part = slice(starts[k] + begin, starts[k] + begin + n_k)
                _add_slot(
                    distance[part], colour[c][part], scale, J[:n_k], water[c], slope, total[c]
                )
            if rate > np.float32(0):
                _move(J, means, squares, slope, rate, root, eps)
    return total


def descend(observations: Observations, start: Array, water: Array, steps: Steps) -> Descent:
    """Take Adam's steps: see `adam.Descent`. Sums are added up in the order of the shares, whoever made them."""
    store = store_of(observations)
    cut = blocks(observations, SHARE)
    colours = np.zeros((3, *start.shape), dtype=np.float32)
    colours[0] = start
    water = water.astype(np.float64)
    means = np.zeros((3, 3))
    squares = np.zeros((3, 3))

    def swept(*step: float) -> tuple[Array, Array]:
        """Return the cost (3,) and dE/dwater (3, 3), and move the colours."""
        water_32, step_32 = water.astype(np.float32), tuple(map(np.float32, step))

        def work(block: Block) -> Any:
            return _swept(
                store, (block.start, block.start + block.n), water_32, colours, step_32
            )

        total = sum(workers.map(work, cut), np.zeros((3, 4)))
        return total[:, 0], -2 * total[:, 1:]

    costs = []
    # numbers that leave their range are the caller's to find
    leaving = np.errstate(over="ignore", invalid="ignore")
    with ThreadPoolExecutor(usable_cores()) as workers, leaving:
        for t in track(range(1, steps.n + 1), PROGRESS):
            rate = steps.rate / (1 - MEAN**t)
            root = math.sqrt(1 - SQUARE**t)
            cost, gradient = swept(rate, root, steps.eps)
            costs.append(cost)
            gradient = steps.shared(gradient)
            means += (1 - MEAN) * (gradient - means)
            squares += (1 - SQUARE) * (gradient**2 - squares)
            water -= rate * means / (np.sqrt(squares) / root + steps.eps)
        cost, _ = swept(0, 1, 1)
    return Descent(colours[0], water, costs[0], cost)
