"""Fits light that differs between observations together with the water.

    I = l (J a + b),    log l = sum_k t_k D_k

D: known columns, one number for each observation; t: their unknown coefficients, the same for all channels. Columns of
single views give gains (exposure.py), columns of the place in the image give a falloff (falloff.py). Weak priors, worth
one observation each, hold the coefficients near 0.

The normal equations are those of model.py with a column d I / d t_k = l (J a + b) D_k for each coefficient
more, common to the channels; colours are eliminated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array, Indices, Mask
from sucre_bench.methods.sucre.levenberg import Bounds, Minimum, minimise
from sucre_bench.methods.sucre.model import ReducedSystem, WaterParameters, transmission, veil
from sucre_bench.multiview.observations import Observations

# Standard deviation of a coefficient beforehand, and the noise of the one observation that this is worth.
_PRIOR, _NOISE = 0.7, 0.01

# Starts of beta and gamma, as optical depths over the median distance, besides the water fitted without light.
_STARTS = ((0.1, 0.3), (0.7, 0.7))

# Pixels that the starts are tried on; tolerance there and of the last descent; most steps of each.
_SCREEN, _ROUGHLY, _TOLERANCE, _STEPS = 1_000, 1e-4, 1e-7, 60

# Largest coefficient.
_MOST = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class ByPixel:
    """Observations one pixel after the other: order (N,), their places in `Observations`; firsts (P,), where each
    pixel's begin; sizes (P,)."""

    order: Indices
    firsts: Indices
    sizes: Indices

    @staticmethod
    def of(few: Observations) -> ByPixel:
        order = np.argsort(np.concatenate([np.arange(m) for m, _ in few.slots()]), kind="stable")
        return ByPixel.sized(order, few.counts.astype(np.int64))

    @staticmethod
    def sized(order: Indices, sizes: Indices) -> ByPixel:
        return ByPixel(order, np.cumsum(sizes) - sizes, sizes)

    def sums(self, values: Array) -> Array:
        """Sum (..., N) over each pixel's observations, and give every observation its pixel's sum."""
        return np.repeat(np.add.reduceat(values, self.firsts, axis=-1), self.sizes, axis=-1)


@dataclass(frozen=True, slots=True, eq=False)
class ObservationsByPixel:
    """All observations of pixels that several views show: z (N,) and I (3, N), in the order of `pixels`."""

    z: Array
    I: Array  # noqa: E741
    pixels: ByPixel

    @staticmethod
    def of(few: Observations) -> ObservationsByPixel:
        pixels = ByPixel.of(few)
        I = few.intensity(slice(None))[:, pixels.order].astype(np.float64)  # noqa: E741
        return ObservationsByPixel(few.distance[pixels.order].astype(np.float64), I, pixels)

    @property
    def n_excess(self) -> int:
        """How many more intensities than colours there are."""
        return 3 * (len(self.z) - len(self.pixels.sizes))

    def every(self, step: int) -> tuple[ObservationsByPixel, Mask]:
        """Return each step-th pixel with all its observations, and which observations (N,) these are."""
        sizes = self.pixels.sizes
        kept = np.repeat(np.arange(len(sizes)) % step == 0, sizes)
        few = ByPixel.sized(self.pixels.order[kept], sizes[::step])
        return ObservationsByPixel(self.z[kept], self.I[:, kept], few), kept

    def colours(self, light: Array, water: WaterParameters) -> tuple[Array, Array, Array]:
        """Return a, b and the best J of each observation's pixel, (3, N); light: (N,)."""
        B, beta, gamma = water.columns()
        a, b = transmission(self.z, beta), veil(self.z, B, gamma)
        x = light * a
        J = self.pixels.sums(x * (self.I - light * b)) / np.maximum(self.pixels.sums(x * x), 1e-30)
        return a, b, J


@dataclass(frozen=True, slots=True, eq=False)
class LightFit:
    """coefficients: (F,); water: fitted with them; error: (3,) standard error of beta with the light free; noise: rms
    of the residuals."""

    coefficients: Array
    water: WaterParameters
    error: Array
    noise: float


def fit_light(sample: ObservationsByPixel, columns: Array, start: WaterParameters) -> LightFit:
    """Fit the coefficients of columns (F, N) and the water; start: fitted without them."""
    distance = float(np.median(sample.z))
    bounds = _bounds(len(columns), distance)
    rates = (np.repeat(np.array(depths)[:, None] / distance, 3, axis=1) for depths in _STARTS)
    starts = [start, *(WaterParameters(start.B, beta, gamma) for beta, gamma in rates)]
    few, kept = sample.every(max(1, len(sample.pixels.sizes) // _SCREEN))
    even = np.zeros(len(columns))
    ends = [
        _descend(few, columns[:, kept], np.concatenate([water.by_channel().ravel(), even]), bounds, _ROUGHLY)
        for water in starts
    ]
    best = min(ends, key=lambda end: float(end.system.cost[0]))
    unknowns = _descend(sample, columns, best.at[0], bounds, _TOLERANCE).at[0]
    plain = _system(sample, columns, unknowns, with_priors=False)
    excess = max(sample.n_excess - len(unknowns), 1)
    noise = float(np.sqrt(plain.cost[0] / excess))
    return LightFit(
        unknowns[9:], WaterParameters.of_channels(unknowns[:9].reshape(3, 3)), _error_of_beta(plain, noise), noise
    )


def promised_noise(sample: ObservationsByPixel, columns: Array, water: WaterParameters) -> tuple[float, float]:
    """Return the rms of the residuals in a water without light, and that which one linear step with it promises."""
    unknowns = np.concatenate([water.by_channel().ravel(), np.zeros(len(columns))])
    system = _system(sample, columns, unknowns, with_priors=False)
    used, scale, inverse = _scaled_inverse(system, 1e-10)
    cost, g = float(system.cost[0]), system.g[0, used] * scale
    gain = float(g @ inverse @ g)
    excess = max(sample.n_excess, 1)
    return float(np.sqrt(cost / excess)), float(np.sqrt(max(cost - gain, 0) / excess))


def _bounds(n: int, distance: float) -> Bounds:
    most = 30 / distance
    lower = np.concatenate([np.zeros(9), np.full(n, -_MOST)])
    upper = np.concatenate([np.tile([1.0, most, most], 3), np.full(n, _MOST)])
    damped = np.concatenate([np.tile([False, True, True], 3), np.ones(n, dtype=bool)])
    return Bounds(lower, upper, damped)


def _descend(sample: ObservationsByPixel, columns: Array, start: Array, bounds: Bounds, tolerance: float) -> Minimum:
    def evaluate(unknowns: Array) -> ReducedSystem:
        return _system(sample, columns, unknowns[0])

    return minimise(evaluate, start[None], bounds, tolerance=tolerance, max_steps=_STEPS)


def _system(sample: ObservationsByPixel, columns: Array, unknowns: Array, with_priors: bool = True) -> ReducedSystem:
    """H (1, n, n), g and cost around the unknowns: B, beta, gamma of each channel, then the coefficients."""
    water = WaterParameters.of_channels(unknowns[:9].reshape(3, 3))
    light = np.exp(unknowns[9:] @ columns)
    a, b, J = sample.colours(light, water)
    B, _, gamma = water.columns()
    x = light * a
    A = np.maximum(sample.pixels.sums(x * x), 1e-30)
    r = sample.I - light * (J * a + b)
    fade = np.exp(-gamma * sample.z)
    of_water = light * np.stack([1 - fade, -sample.z * J * a, B * sample.z * fade])  # (3 parameters, 3 channels, N)
    n = 9 + len(columns)
    H, g = np.zeros((n, n)), np.zeros(n)
    for c in range(3):
        derivatives = np.concatenate([of_water[:, c], columns * (light * (J[c] * a[c] + b[c]))])
        derivatives -= x[c] * (sample.pixels.sums(x[c] * derivatives) / A[c])
        places = np.r_[3 * c : 3 * c + 3, 9:n]
        H[np.ix_(places, places)] += derivatives @ derivatives.T
        g[places] += derivatives @ r[c]
    cost = float((r * r).sum())
    if with_priors:
        weight = (_NOISE / _PRIOR) ** 2
        H[np.arange(9, n), np.arange(9, n)] += weight
        g[9:] -= weight * unknowns[9:]
        cost += weight * float((unknowns[9:] ** 2).sum())
    return ReducedSystem(H[None], g[None], np.array([cost]))


def _scaled_inverse(system: ReducedSystem, rcond: float) -> tuple[Indices, Array, Array]:
    """Return the unknowns that the cost depends on, what scales H to unit diagonal, and the inverse of H so scaled."""
    H = system.H[0]
    used = np.flatnonzero(np.diag(H) > 0)
    scale = 1 / np.sqrt(np.diag(H)[used])
    return used, scale, np.linalg.pinv(H[np.ix_(used, used)] * scale[:, None] * scale, rcond=rcond, hermitian=True)


def _error_of_beta(system: ReducedSystem, noise: float) -> Array:
    used, scale, inverse = _scaled_inverse(system, 1e-14)
    variance = np.full(len(system.H[0]), np.inf)
    variance[used] = noise**2 * np.diag(inverse).clip(min=0) * scale**2
    return np.asarray(np.sqrt(variance[[1, 4, 7]]))
