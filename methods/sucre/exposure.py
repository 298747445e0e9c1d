"""Estimates one gain for each view together with the water, for cameras that expose automatically.

    I = g_v (J a + b)

g_v: the exposure of view v, the same for all channels. All gains times s, with J and B divided by s, explain the same
observations, so the target has g = 1: J is in its exposure. A gain and exp(-beta z) act alike on a view whose points
all have one distance. So only views that show a range of distances separate gains from attenuation. Without such views,
the standard error of beta is large. Weak priors, worth one observation each, hold the gains near 1.

The normal equations are those of normal_equations.py with a column d I / d log g_v = g (J a + b) for each view more,
common to the channels; colours are eliminated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array, Indices
from sucre_bench.errors import SolveError
from sucre_bench.methods.sucre.levenberg import Bounds, Minimum, minimise
from sucre_bench.methods.sucre.model import WaterParameters, transmission, veil
from sucre_bench.methods.sucre.normal_equations import ReducedSystem
from sucre_bench.multiview.observations import Observations

# Pixels that the gains are fitted to.
_SAMPLE = 5_000

# Standard deviation of log g beforehand, and the noise of the one observation that this is worth.
_PRIOR, _NOISE = 0.7, 0.01

# Starts of beta and gamma, as optical depths over the median distance, besides the water fitted without gains.
_STARTS = ((0.1, 0.3), (0.7, 0.7))

_TOLERANCE, _STEPS = 1e-7, 60

# Gains that differ by this much are reported; from so many observations a view on.
_DIFFERENT, _OFTEN = 0.05, 100

# beta is not told from the gains where its standard error over the median distance is above this optical depth.
_LOOSE = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """gains: of the views in the sample by name, 1 for the target, or for another view if the sample lacks it; water:
    fitted with them; error: (3,) standard error of beta; is_separable: whether distances tell the gains from
    attenuation."""

    gains: dict[str, float]
    water: WaterParameters
    error: Array
    is_separable: bool

    @property
    def limit(self) -> str:
        """What is said of gains that are not separable."""
        return "distances do not separate exposure from attenuation; use exposure=constant, or more views"


def estimate(observations: Observations, target: str, water_start: WaterParameters, *, seed: int = 0) -> Exposure:
    """Fit gains and water to random pixels seen more than once.

    observations: with `view`; target: the name of the view whose gain is 1; water_start: fitted without gains.
    Raises SolveError when no pixel is seen twice.
    """
    if observations.view is None or not observations.n_repeated:
        raise SolveError("exposure=per_view needs pixels that several views show; use exposure=constant")
    rng = np.random.default_rng(seed)
    n = observations.n_repeated
    few = observations.take(np.sort(rng.choice(n, min(n, _SAMPLE), replace=False)))
    sample = _Sample.of(few, target)
    distance = float(np.median(few.distance))
    bounds = _bounds(sample.n_free, distance)
    starts = [water_start, *(_water_at(water_start, *depths, distance) for depths in _STARTS)]
    ends = [_descend(sample, water, bounds) for water in starts]
    best = min(ends, key=lambda end: float(end.system.cost[0]))
    unknowns = best.at[0]
    gains = {few.views[k]: 1.0 for k in np.unique(sample.view)}
    gains |= {few.views[k]: float(gain) for k, gain in zip(sample.free, np.exp(unknowns[9:]), strict=True)}
    error = _error_of_beta(sample, best)
    is_separable = bool((error * distance < _LOOSE).all())
    return Exposure(gains, WaterParameters.of_channels(unknowns[:9].reshape(3, 3)), error, is_separable)


def differing_exposure(observations: Observations, water: WaterParameters) -> tuple[str, ...]:
    """Return what to say where the exposures of views differ, in the water that was fitted without gains.

    The gains here are those that fit each view best with that water and its colours. They are too near 1, since water
    and colours have taken part of them.
    """
    few = observations.take(np.arange(min(observations.n_repeated, _SAMPLE)))
    sample = _Sample.of(few, "")
    a, b, J = _colours(sample, np.ones(len(sample.z)), water)
    model = J * a + b
    n = len(few.views)
    counts = np.bincount(sample.view, minlength=n)
    often = counts > _OFTEN
    if not often.any():
        return ()
    total = [np.bincount(sample.view, values.sum(axis=0), n)[often] for values in (sample.I * model, model**2)]
    gains = total[0] / np.maximum(total[1], 1e-30)
    if gains.max() < (1 + _DIFFERENT) * gains.min():
        return ()
    spread = f"{gains.min():.2f} to {gains.max():.2f}"
    return (
        f"exposure seems to differ between views (gains {spread}); exposure=per_view fits it, "
        "lamp=true a lamp on the camera",
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Sample:
    """Observations pixel after pixel: z, view (N,); I (3, N); firsts (P,) where each pixel's begin; sizes (P,); free:
    indices of the views whose gains are unknown."""

    z: Array
    I: Array  # noqa: E741
    view: Indices
    firsts: Indices
    sizes: Indices
    free: Indices

    @property
    def n_free(self) -> int:
        return len(self.free)

    @staticmethod
    def of(few: Observations, target: str) -> _Sample:
        assert few.view is not None
        by_pixel = np.argsort(np.concatenate([np.arange(m) for m, _ in few.slots()]), kind="stable")
        I = few.intensity(slice(None))[:, by_pixel].astype(np.float64)  # noqa: E741
        view, sizes = few.view[by_pixel].astype(np.int64), few.counts.astype(np.int64)
        seen = np.unique(view)
        free = np.array([k for k in seen if few.views[k] != target], dtype=np.int64)
        if len(free) == len(seen) and target:  # the target shows none of them
            free = free[1:]
        return _Sample(few.distance[by_pixel].astype(np.float64), I, view, np.cumsum(sizes) - sizes, sizes, free)

    def over_pixels(self, values: Array) -> Array:
        """Sum (..., N) over each pixel's observations, and give every observation its pixel's sum."""
        return np.repeat(np.add.reduceat(values, self.firsts, axis=-1), self.sizes, axis=-1)


def _bounds(n_gains: int, distance: float) -> Bounds:
    most = 30 / distance
    lower = np.concatenate([np.zeros(9), np.full(n_gains, -2.0)])
    upper = np.concatenate([np.tile([1.0, most, most], 3), np.full(n_gains, 2.0)])
    damped = np.concatenate([np.tile([False, True, True], 3), np.ones(n_gains, dtype=bool)])
    return Bounds(lower, upper, damped)


def _water_at(water: WaterParameters, beta: float, gamma: float, distance: float) -> WaterParameters:
    return WaterParameters(water.B, np.full(3, beta / distance), np.full(3, gamma / distance))


def _descend(sample: _Sample, water: WaterParameters, bounds: Bounds) -> Minimum:
    start = np.concatenate([water.by_channel().ravel(), np.zeros(sample.n_free)])

    def evaluate(unknowns: Array) -> ReducedSystem:
        return _system(sample, unknowns[0])

    return minimise(evaluate, start[None], bounds, tolerance=_TOLERANCE, max_steps=_STEPS)


def _colours(sample: _Sample, gain: Array, water: WaterParameters) -> tuple[Array, Array, Array]:
    """Return a, b and the best J of each observation's pixel, (3, N)."""
    B, beta, gamma = water.columns()
    a, b = transmission(sample.z, beta), veil(sample.z, B, gamma)
    x = gain * a
    J = sample.over_pixels(x * (sample.I - gain * b)) / np.maximum(sample.over_pixels(x * x), 1e-30)
    return a, b, J


def _system(sample: _Sample, unknowns: Array, with_priors: bool = True) -> ReducedSystem:
    """H (1, n, n), g and cost around the unknowns: B, beta, gamma of each channel, then log g of the free views."""
    water = WaterParameters.of_channels(unknowns[:9].reshape(3, 3))
    gains = np.ones(int(sample.view.max()) + 1)
    gains[sample.free] = np.exp(unknowns[9:])
    gain = gains[sample.view]
    a, b, J = _colours(sample, gain, water)
    B, _, gamma = water.columns()
    x = gain * a
    A = np.maximum(sample.over_pixels(x * x), 1e-30)
    r = sample.I - gain * (J * a + b)
    fade = np.exp(-gamma * sample.z)
    of_water = gain * np.stack([1 - fade, -sample.z * J * a, B * sample.z * fade])  # (3 parameters, 3 channels, N)
    of_view = (sample.view == sample.free[:, None]).astype(np.float64)  # (F, N)
    n = 9 + sample.n_free
    H, g = np.zeros((n, n)), np.zeros(n)
    for c in range(3):
        columns = np.concatenate([of_water[:, c], of_view * (gain * (J[c] * a[c] + b[c]))])
        columns -= x[c] * (sample.over_pixels(x[c] * columns) / A[c])
        places = np.r_[3 * c : 3 * c + 3, 9:n]
        H[np.ix_(places, places)] += columns @ columns.T
        g[places] += columns @ r[c]
    cost = float((r * r).sum())
    if with_priors:
        weight = (_NOISE / _PRIOR) ** 2
        H[np.arange(9, n), np.arange(9, n)] += weight
        g[9:] -= weight * unknowns[9:]
        cost += weight * float((unknowns[9:] ** 2).sum())
    return ReducedSystem(H[None], g[None], np.array([cost]))


def _error_of_beta(sample: _Sample, end: Minimum) -> Array:
    """(3,) standard errors, with the gains free."""
    system = _system(sample, end.at[0], with_priors=False)
    H = system.H[0]
    used = np.flatnonzero(np.diag(H) > 0)
    scale = 1 / np.sqrt(np.diag(H)[used])
    inverse = np.linalg.pinv(H[np.ix_(used, used)] * scale[:, None] * scale, rcond=1e-14, hermitian=True)
    excess = 3 * (len(sample.z) - len(sample.sizes)) - len(used)
    variance = np.full(len(H), np.inf)
    variance[used] = float(system.cost[0]) / max(excess, 1) * np.diag(inverse).clip(min=0) * scale**2
    return np.sqrt(variance[[1, 4, 7]])
