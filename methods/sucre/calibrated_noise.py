"""The standard deviation of colours, from two kinds of noise.

The noise of the camera is alike at every distance. What differs between views (light, wrong pairs, texture that one
view resolves and another does not) belongs to the scene, so water weakens it as it weakens colours:

    variance of I - J a - b  =  sigma^2 + (tau a)^2.

Near and far observations tell the two apart. One common standard deviation would be too large far away, where little of
tau is left, and far colours would be taken for noise. The best J of the observations of a pixel, with A = sum w a^2,
then has the variance

    sigma^2 / A  +  tau^2 (sum w^2 a^4) / A^2.

Noise is alike in stored intensities. In linear light decoded from them it is sigma times the slope t of the curve: less
in dark pixels. The first term is then sigma^2 (sum w a^2 t^2) / A^2.

Robust weights v = 1 / (1 + s^2 / c^2)^2 (robust.py) are no known precisions: they are small because residuals are
large, and colours follow the observations that they favour. With w the weights that are known beforehand (a lamp's,
gains), the variance of an observation is then that of the residuals, each counted v times, and J has the variance

    k sum w (v a)^2 (sigma^2 t^2 + tau^2 w a^2) / (sum w v a^2)^2,    k = (sum v / sum psi')^2,

where psi' = v (1 - 4/3 (1 - v^1/2)) is the slope of the influence v r, its mean over three channels alike: the variance
of an M-estimator (Huber 1981, sec. 3.2). Without robust weights v and k are 1.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.methods.sucre.model import WaterParameters, transmission, veil
from sucre_bench.methods.sucre.solvers import Solution
from sucre_bench.multiview.observations import Observations

# Pixels that the noise is estimated on, the fewest that tell it, and classes of transmission.
_SAMPLE, _FEWEST, _CLASSES = 30_000, 200, 12

# The least noise: rounding to 8 bits has a standard deviation of .0011.
_LEAST = 1e-3

# Half the difference of intensities that the slope of the curve is taken over.
_STEP = 0.5 / 255

# The least transmission: less light says nothing about a colour, and its square would be no number in float32.
_DARK = 1e-6

# The least mean slope of the influence, as a share of the mean weight.
_LEAST_SLOPE = 0.25

# An observation that has more than this share of its pixel's information has hardly any residual.
_ALONE = 0.95


def calibrated(observations: Observations, solution: Solution, *, decoded: bool = False) -> Solution:
    """Return the solution with standard deviations from both kinds of noise; as it is where few pixels repeat.

    observations: without robust weights, which are in the solution; decoded: they are linear light, decoded from stored
    intensities.
    """
    if observations.n_repeated < _FEWEST or not np.isfinite(solution.uncertainty.noise).all():
        return solution
    A, At2, A2 = np.zeros((3, 3, len(observations.pixels)), dtype=np.float32)
    for n, part in observations.slots():
        information, v = _information(observations, solution.water, part), _robust(observations, solution.weight, part)
        A[:, :n] += v * information
        At2[:, :n] += v**2 * information * _slope(observations, part, decoded) ** 2
        A2[:, :n] += (v * information) ** 2
    of_noise = solution.uncertainty.noise[:, None] ** 2 / A
    of_water = np.maximum(solution.deviation**2 - of_noise, 0)
    sigma, tau = noise_parts(observations, solution, decoded=decoded)[:, :, None]
    k = _of_choice(observations, solution.weight)
    deviation = np.sqrt(of_water + k * (sigma**2 * At2 + tau**2 * A2) / A**2)
    return replace(solution, deviation=deviation.astype(np.float32))


def noise_parts(observations: Observations, solution: Solution, *, decoded: bool = False) -> Array:
    """Return sigma and tau of each channel, (2, 3), from a sample of the pixels seen more than once.

    They explain the mean squares of the studentised residuals in classes of transmission, by least squares without
    negative parts. In a channel with too few residuals, sigma is the common standard deviation.
    """
    from scipy.optimize import nnls

    step = -(-observations.n_repeated // _SAMPLE)
    places = np.arange(0, observations.n_repeated, step)
    few = observations.take(places)
    weight = None if solution.weight is None else replace(observations, weight=solution.weight).take(places).weight
    squares, strength = _squared_residuals(few, weight, solution.water, solution.J[:, places])
    slopes = np.concatenate([_slope(few, part, decoded) ** 2 for _, part in few.slots()], axis=1)
    counted = np.broadcast_to(_robust(few, weight, slice(None)), squares.shape)
    parts = np.zeros((3, 2))
    for c in range(3):
        known = np.isfinite(squares[c])
        if known.sum() < _FEWEST:
            parts[c] = solution.uncertainty.noise[c] ** 2, 0
            continue
        y, t, x, v = squares[c, known], slopes[c, known], strength[c, known], counted[c, known]
        classes = [one for one in np.array_split(np.argsort(x / t), _CLASSES) if len(one)]
        y, t, x = (np.array([np.average(values[one], weights=v[one]) for one in classes]) for values in (y, t, x))
        scale = 1 / np.maximum(y, _LEAST**2)
        parts[c], _ = nnls(np.stack([t, x], axis=1) * scale[:, None], y * scale)
    sigma, tau = np.sqrt(parts.T)
    return np.stack([np.maximum(sigma, _LEAST), tau])


def _robust(observations: Observations, weight: Array | None, part: slice) -> Array:
    """Return the robust part v, (n,) or (3, n), of the weights of a solution, 1 without any."""
    if weight is None:
        return np.ones(len(observations.distance[part]), dtype=np.float32)
    if observations.weight is None:
        return weight[..., part]
    whole, known = np.broadcast_arrays(weight[..., part], observations.weight[..., part])
    return np.divide(whole, known, out=np.zeros_like(whole), where=known > 0)


def _of_choice(observations: Observations, weight: Array | None) -> float:
    """Return k, see above, from the observations of pixels seen more than once."""
    if weight is None:
        return 1.0
    repeated = [_robust(observations, weight, part)[..., : observations.n_repeated] for _, part in observations.slots()]
    v = np.concatenate(repeated, axis=-1).astype(np.float64)
    slope = v * (1 - 4 / 3 * (1 - np.sqrt(v)))
    return float(v.sum() / max(slope.sum(), _LEAST_SLOPE * v.sum())) ** 2


def _slope(observations: Observations, part: slice, decoded: bool) -> Array:
    """Return how many times larger than in stored intensities the noise of recorded light is, (3, n).

    Under a lamp or with gains, intensities are recorded light over l, of weight l^2.
    """
    linear = observations.intensity(part)
    if not decoded:
        return np.ones_like(linear)
    if observations.weight is not None:
        linear = linear * np.sqrt(observations.weight[..., part])
    stored = srgb_encode(linear)
    return np.asarray((srgb_decode(stored + _STEP) - srgb_decode(stored - _STEP)) / (2 * _STEP), dtype=np.float32)


def _information(observations: Observations, water: WaterParameters, part: slice) -> Array:
    """w a^2 (3, n) of observations."""
    a = transmission(observations.distance[part], water.columns()[1].astype(np.float32)).clip(min=_DARK)
    return np.asarray(a * a if observations.weight is None else observations.weight[..., part] * a * a)


def _squared_residuals(
    observations: Observations, weight: Array | None, water: WaterParameters, J: Array
) -> tuple[Array, Array]:
    """Return squared studentised residuals (3, N), NaN where an observation is nearly alone, and w a^2 (3, N).

    weight: with its robust part, of the colours J.
    """
    B, beta, gamma = (column.astype(np.float32) for column in water.columns())
    A = np.zeros_like(J)
    for n, part in observations.slots():
        A[:, :n] += _robust(observations, weight, part) * _information(observations, water, part)
    squares, strength = [], []
    for n, part in observations.slots():
        z, x2 = observations.distance[part], _information(observations, water, part)
        w = 1 if observations.weight is None else observations.weight[..., part]
        r = observations.intensity(part) - J[:, :n] * transmission(z, beta) - veil(z, B, gamma)
        v = _robust(observations, weight, part)
        h = v * x2 / A[:, :n]
        usable = (h < _ALONE) & (v * x2 > 0)
        squares.append(np.where(usable, w * r * r / np.where(usable, 1 - h, 1), np.nan))
        strength.append(x2)
    return np.concatenate(squares, axis=1).astype(np.float64), np.concatenate(strength, axis=1).astype(np.float64)
