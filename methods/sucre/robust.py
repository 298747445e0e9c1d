"""Robust weights: observations that do not fit count less, for example animals that move or wrong pairs.

Such an observation is wrong in all three channels at once, so it has one weight. With y = (I - b) / noise and x = a, an
observation's misfit in the current water is the squared studentised residual, summed over the channels,

    s^2 = sum_c (y - J x)^2 / (1 - h),    h = v x^2 / sum v x^2,    v = 1 / (1 + s^2 / c^2)^2

(Geman & McClure 1987; leverages h as in Huber 1981, sec. 7.2). J and v are iterated in turn. The loss redescends: an
animal stops pulling on the water. So the start of J decides which observations count as wrong. It is the weighted
median, the L1 minimum. Of two observations either may be wrong. They start from the mean and, being studentised, have
the same misfit, so such a pixel counts less as a whole and its colour stays the mean.

Weights help where a few observations are wrong and the model explains the others. They harm where the model explains
nothing well, as in photographs with unknown tone curves and coarse depth maps: misfits are then everywhere, and a water
that leaves out the inconvenient ones is no better. judge.py tells the two apart.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.machine.compute import usable_cores
from sucre_bench.methods.sucre.model import (
    LEAST,
    WaterParameters,
    eliminated,
    transmission,
    veil,
)
from sucre_bench.methods.sucre.passes import Block, blocks, fill
from sucre_bench.multiview.observations import Observations

if TYPE_CHECKING:
    from sucre_bench.methods.sucre.exact import WaterFit

# c^2, in the misfit's units: a good observation has s^2 about 3, one for each channel. On clean data with normal noise
# colours lose .1 dB to the weights; a third of it would lose .6 dB.
C2 = 30.0

# An observation is wrong if its weight is below this: s^2 > c^2, which noise makes in one of 700,000.
WRONG = 1 / 4

# A view of another place, mirrored, or with another depth map has more than this share of wrong observations.
_ELSEWHERE = 0.8
# Fewer observations tell nothing.
_TOLD = 10

# Light below this share tells no colour; dividing by it would overflow.
_FAINTEST = 1e-20

# Rounds of J and v for given water: started at the median they settle at once.
_ROUNDS = 4

_ELEMENTS = 1 << 14  # places in a block: temporaries stay in the cache

# Pixels that the noise is estimated on, and the least noise: rounding to 8 bits has a standard deviation of 1e-3.
_SAMPLE = 5_000
LEAST_NOISE = 1e-3

# The median of |x| is this part of the standard deviation of a normal x.
_MEDIAN_OF_NORMAL = 0.6745


def fit_robustly(
    observations: Observations,
    fit: Callable[..., WaterFit],
    *,
    tolerance: float = 5e-4,
    max_rounds: int = 6,
    plain: WaterFit | None = None,
) -> tuple[WaterFit, Observations]:
    """Fit the water and the weights in turn until a round changes no intensity by more than the tolerance.

    fit: finds the water of weighted observations; tolerance: of a and b at the distances observed, as an intensity;
    plain: what fit finds without robust weights, if that is known.
    Returns the last fit, and the observations with the weights it was made with.
    """
    weighted = observations
    found = plain or fit(weighted)
    near = None  # weights may lead to another minimum, once
    z = np.quantile(observations.distance, (0.05, 0.5, 0.95))
    for _ in range(max_rounds):
        before = found.water
        weighted = reweighted(observations, before, robust_noise(observations, before))
        found = fit(weighted, near=near)
        near = found.water
        if np.abs(_effect(found.water, z) - _effect(before, z)).max() <= tolerance:
            break
    return found, weighted


def contradicted_views(observations: Observations, v: Array) -> list[str]:
    """Return what to say of views that most of the others contradict; v: the `trust` in observations."""
    if observations.view is None:
        return []
    n = np.bincount(observations.view, minlength=len(observations.views))
    wrong = np.bincount(observations.view, v < WRONG, len(observations.views))
    return [
        f"{name} shows other things than the other views; if it is another place, mirrored or turned, or has another "
        "view's depth map, take it out of the dataset"
        for name in np.array(observations.views)[(n >= _TOLD) & (wrong > _ELSEWHERE * n)]
    ]


def _effect(water: WaterParameters, z: Array) -> Array:
    """Return a and b at distances z: (2, Z, 3)."""
    return np.stack(
        [transmission(z[:, None], water.beta), veil(z[:, None], water.B, water.gamma)]
    )


def robust_noise(observations: Observations, water: WaterParameters) -> Array:
    """Return the standard deviation (3,) of observations, in intensity; 12 % wrong ones raise it by 15 %.

    It comes from the median of the studentised residuals of a sample of pixels, so it includes what the model does not
    explain.
    """
    if not observations.n_repeated:
        return np.full(3, LEAST_NOISE)
    step = -(-observations.n_repeated // _SAMPLE)
    sample = observations.take(np.arange(0, observations.n_repeated, step))
    noise = np.full(3, 0.02)
    for _ in range(3):  # the weights of the residuals depend on it
        parts = [_settled(sample, block, water, noise) for block in blocks(sample, _ELEMENTS)]
        t = np.concatenate([t[:, v > 0] for v, t in parts], axis=1)  # (3, N)
        noise = np.maximum(
            noise * np.median(np.abs(t), axis=1) / _MEDIAN_OF_NORMAL, LEAST_NOISE
        )
    return noise


def trust(
    observations: Observations, water: WaterParameters, noise: Array | None = None
) -> Array:
    """Return the robust weight (N,) float32, 0 to 1, of observations in a water: how well each fits; 1 if seen once.

    noise: (3,) standard deviation of an observation of weight 1, in intensity; default `robust_noise`.
    """
    noise = robust_noise(observations, water) if noise is None else noise
    v = np.empty(len(observations), dtype=np.float32)

    def work(block: Block) -> None:
        settled, _ = _settled(observations, block, water, noise)
        for k, (n, part) in enumerate(observations.slots(block.start, block.start + block.n)):
            v[part] = settled[k, :n]

    with ThreadPoolExecutor(usable_cores()) as threads:
        list(threads.map(work, blocks(observations, _ELEMENTS)))
    return v


def trusted(observations: Observations, v: Array) -> Observations:
    """Return the observations with each weight times the trust (N,) in it."""
    return replace(
        observations, weight=v if observations.weight is None else v * observations.weight
    )


def reweighted(
    observations: Observations, water: WaterParameters, noise: Array
) -> Observations:
    """Return the observations with each weight lowered by how badly it fits the water; noise: as in `trust`."""
    return trusted(observations, trust(observations, water, noise))


def _settled(
    observations: Observations, block: Block, water: WaterParameters, noise: Array
) -> tuple[Array, Array]:
    """Return v (K, n) of a block, 0 in empty places, and its studentised residuals (3, K, n), in units of the noise."""
    z, I, w = fill(observations, block)
    s = np.sqrt(w)  # the noise is that of weight 1
    B, beta, gamma = (column[:, None].astype(np.float32) for column in water.columns())
    x = s * transmission(z, beta)
    y = s * (I - veil(z, B, gamma)) / noise[:, None, None].astype(np.float32)
    there = s > 0 if s.ndim == 2 else (s > 0).all(axis=0)
    several = there.sum(axis=0) > 2
    v = np.where(several, _weights(y - _l1_minimum(x, y)[:, None] * x), 1) * there
    for _ in range(_ROUNDS):
        t = _studentised(x, y, v)
        v = _weights(t) * there
    return v, t


def _weights(t: Array) -> Array:
    """v (K, n) of studentised residuals (3, K, n)."""
    return 1 / (1 + (t * t).sum(axis=0) / np.float32(C2)) ** 2


def _studentised(x: Array, y: Array, v: Array) -> Array:
    A, _, r = eliminated(x, y, 1, v)
    alone = 1 - v * x * x / A.clip(min=LEAST)
    # An observation that is alone has no residual but rounding.
    return np.where(alone > 1e-4, r / np.sqrt(np.maximum(alone, 1e-4)), 0)


def _l1_minimum(x: Array, y: Array) -> Array:
    """The J (3, n) of least sum |y - J x|: the median of y / x with weights x (3, K, n)."""
    there = x > _FAINTEST
    ratio = np.where(there, y / np.where(there, x, 1), np.inf)  # the empty places last
    order = np.argsort(ratio, axis=1)
    below = np.cumsum(np.take_along_axis(x, order, axis=1), axis=1)
    middle = np.take_along_axis(
        order, (below < below[:, -1:] / 2).sum(axis=1, keepdims=True), axis=1
    )
    J = np.take_along_axis(ratio, middle, axis=1)[:, 0]
    return np.where(np.isfinite(J), J, 0)
