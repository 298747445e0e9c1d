"""Noise of colours: how large it is, and two ways to lower it.

**Its size** (`calibrated`). The noise of the camera is alike at every distance. What differs between views (light,
wrong pairs, texture that one view resolves and another does not) belongs to the scene, so water weakens it as it
weakens colours:

    variance of I - J a - b  =  sigma^2 + (tau a)^2.

Near and far observations tell the two apart. One common standard deviation would be too large far away, where little of
tau is left, and far colours would be taken for noise. The best J of the observations of a pixel, with A = sum w a^2,
then has the variance

    sigma^2 / A  +  tau^2 (sum w^2 a^4) / A^2.

Robust weights v = 1 / (1 + s^2 / c^2)^2 (robust.py) are no known precisions: they are small because residuals are
large, and colours follow the observations that they favour. With w the weights that are known beforehand (of light,
gains), the variance of an observation is then that of the residuals, each counted v times, and J has the variance

    k sum w (v a)^2 (sigma^2 + tau^2 w a^2) / (sum w v a^2)^2,    k = (sum v / sum psi')^2,

where psi' = v (1 - 4/3 (1 - v^1/2)) is the slope of the influence v r, its mean over three channels alike: the variance
of an M-estimator (Huber 1981, sec. 3.2). Without robust weights v and k are 1.

**Two channels follow the third** (`followed`). Water takes one channel first, mostly red, so that channel is noisy
where another is still sharp. On one surface the channels are nearly a linear function of each other. With the
best-known channel g, a window of weighted least squares gives for another channel c

    P = alpha J_g + beta,    r = the mean square of J_c - P,    m = max(r - kappa v, 0),

where v is the mean variance of the noise of J_c. So m is what g does not explain and noise does not either: things of
another colour. The colour becomes

    J_c' = P + m / (m + kappa v) (J_c - P),

the local Wiener filter (Lee 1980) around a guided filter (He et al. 2013). Where noise is small, nothing changes.
Standard deviations also contain how views differ smoothly (light, exposure). Neighbours share that, so no window shows
it. kappa, at most 1, is the share of the variance that differs from pixel to pixel: a low percentile of r / v. The
variance that is left is (1 - kappa) v + kappa v m / (m + kappa v).

**Noisy colours go to the mean** (`ImagePrior`, empirical Bayes). Little light arrives from far away, and dividing by a
small transmission magnifies the noise. Water takes red first, so red is lost where green and blue are still known.
Three means, one a channel, would then paint dark places red: the mean of red beside a green and a blue near 0. The
three channels of a surface are alike, so they are shrunk together. A colour is its brightness s times a reflectance
that differs little from the image's mean w (mean of channels 1):

    J = s (w + e),    e normal with deviation d in each channel,    s normal with mean s0 and deviation S.

With the variance v of J and c = (d s)^2, the best brightness and colour are

    s = (sum w J / (v + c)) / (sum w^2 / (v + c)),    J' = s' w + c / (c + v) (J - s w),

where s' is s, shrunk towards s0 by its own variance (Efron & Morris 1973). Channels that are known give the brightness,
and a channel that is lost follows it. A dark pixel has little chroma, a bright one as much as it shows. w, s0 and S
come from the image itself. d is SPREAD: most images are almost gray, and few things in them have colours.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.methods.sucre.model import transmission
from sucre_bench.methods.sucre.residuals import information_of, residuals_of
from sucre_bench.multiview.observations import Observations

if TYPE_CHECKING:
    from sucre_bench.methods.sucre.solution import Solution

# Pixels that the noise is estimated on, the fewest that tell it, and classes of transmission.
_SAMPLE = 30_000
_FEWEST = 200
_CLASSES = 12

# The least noise: rounding to 8 bits has a standard deviation of .0011.
_LEAST_NOISE = 1e-3

# The least mean slope of the influence, as a share of the mean weight.
_LEAST_SLOPE = 0.25

# An observation that has more than this share of its pixel's information has hardly any residual.
_ALONE = 0.95

# `followed`. Half a window, as a share of the image's width, and at least so many pixels.
_HALF = 0.005
_FEWEST_PX = 3

# Variance of things that look alike, added to the guide's and to that of weights.
_ALIKE = 1e-4
_FLOOR = 1e-3

# The percentile of r / v that is taken for noise alone, and the one of relative noise that ranks channels.
_PLAIN = 10
_WORST = 90

# Least brightness that noise is compared with, the variance of a colour without any information, and a divisor.
_DARK = 0.02
_UNKNOWN = 1e4
_TINY = 1e-9

# `ImagePrior`. Deviation of reflectances. Less of it helps made scenes as shown, more of it charts. In linear light:
# sRGB's curve raises bright intensities to nearly the power 2.4, which multiplies relative deviations by as much. A
# photograph agreed.
SPREAD = 0.2
SPREAD_LINEAR = 2.4 * SPREAD

_ROUNDS = 30
_ROUNDS_OF_S = 4

# Pixels that the mean colour is estimated from, and pixels that are worked on at a time.
_SAMPLE_OF_PRIOR = 20_000
_BLOCK = 1 << 15

# Least variance of the brightness of an image, .01 squared: with less, all pixels would become equally bright.
_LEAST_VARIANCE = 1e-4

# No surface is more than so many times as bright as the brightest percent, by more than so many deviations. Marine
# snow far away is 10 to 100 times as bright; real photographs have no such pixels. In linear light 3 to the power 2.4.
# What the camera could show from nearby, up to 1, is never too bright: a white chart before dark ground, say.
_BRIGHTEST = 0.99
_TIMES = 3
_TIMES_LINEAR = 14
_SURE = 4

# Variances of a colour that is known as well as can be, and of one without any information.
_EXACT = 1e-7
_ENDLESS = 1e12

# The least sum that is divided by.
_LEAST_SUM = 1e-100


# -- the size of the noise -----------------------------------------------------------------------------------


def calibrated(observations: Observations, solution: Solution) -> Solution:
    """Return the solution with standard deviations from both kinds of noise; as it is where few pixels repeat.

    observations: without robust weights, which are in the solution.
    """
    if observations.n_repeated < _FEWEST or not np.isfinite(solution.uncertainty.noise).all():
        return solution
    A, vA, A2 = np.zeros((3, 3, len(observations.pixels)), dtype=np.float32)
    trust = _trust(observations, solution)
    for n, part in observations.slots():
        a = transmission(
            observations.distance[part], solution.water.columns()[1].astype(np.float32)
        )
        information = information_of(observations, a, part)
        v = trust[part]
        A[:, :n] += v * information
        vA[:, :n] += v**2 * information
        A2[:, :n] += (v * information) ** 2
    v = trust[observations.place < observations.n_repeated].astype(np.float64)
    slope = v * (1 - 4 / 3 * (1 - np.sqrt(v)))
    k = float(v.sum() / max(slope.sum(), _LEAST_SLOPE * v.sum())) ** 2
    of_noise = solution.uncertainty.noise[:, None] ** 2 / A
    of_water = np.maximum(solution.deviation**2 - of_noise, 0)
    sigma, tau = noise_parts(observations, solution)[:, :, None]
    deviation = np.sqrt(of_water + k * (sigma**2 * vA + tau**2 * A2) / A**2)
    return replace(solution, deviation=deviation.astype(np.float32))


def noise_parts(observations: Observations, solution: Solution) -> Array:
    """Return sigma and tau of each channel, (2, 3), from a sample of the pixels seen more than once.

    They explain the mean squares of the studentised residuals in classes of transmission, by least squares without
    negative parts. In a channel with too few residuals, sigma is the common standard deviation.
    """
    from scipy.optimize import nnls

    places = np.arange(0, observations.n_repeated, -(-observations.n_repeated // _SAMPLE))
    few = observations.take(places)
    trusted = replace(observations, weight=_trust(observations, solution)).take(places).weight
    counted = np.broadcast_to(np.asarray(trusted), few.colour.shape)
    J = solution.J[:, places]
    r, h, strength, _ = residuals_of(few, J, solution.water, counted)
    parts = np.zeros((3, 2))
    for c in range(3):
        known = (h[c] < _ALONE) & (h[c] > 0)
        if known.sum() < _FEWEST:
            parts[c] = solution.uncertainty.noise[c] ** 2, 0
            continue
        x = strength[c, known].astype(np.float64)
        v = counted[c, known]
        y = (r[c, known] ** 2 / (1 - h[c, known])).astype(np.float64)
        classes = [one for one in np.array_split(np.argsort(x), _CLASSES) if len(one)]
        y, x = (
            np.array([np.average(values[one], weights=v[one]) for one in classes])
            for values in (y, x)
        )
        scale = 1 / np.maximum(y, _LEAST_NOISE**2)
        parts[c], _ = nnls(np.stack([np.ones_like(x), x], axis=1) * scale[:, None], y * scale)
    sigma, tau = np.sqrt(parts.T)
    return np.stack([np.maximum(sigma, _LEAST_NOISE), tau])


def _trust(observations: Observations, solution: Solution) -> Array:
    return (
        np.ones(len(observations), dtype=np.float32)
        if solution.trust is None
        else solution.trust
    )


# -- two channels follow the third ---------------------------------------------------------------------------


def followed(J: Array, deviation: Array) -> tuple[Array, Array]:
    """Return colours and standard deviations (H, W, 3) float32 with less noise in two channels.

    J, deviation: (H, W, 3), NaN = no colour. A deviation that is not known, NaN or infinite, stays so.
    """
    known = np.asarray(np.isfinite(J).all(axis=-1))
    result, left = np.array(J, dtype=np.float32), np.array(deviation, dtype=np.float32)
    if not known.any():
        return result, left
    variance = (
        np.where(np.isfinite(deviation), deviation, np.sqrt(_UNKNOWN)).astype(np.float32) ** 2
    )
    colours = np.where(known[..., None], J, 0).astype(np.float32)
    relative = np.sqrt(variance[known]) / np.maximum(np.abs(J[known]), _DARK)
    best = int(np.argmin(np.percentile(relative, _WORST, axis=0)))
    half = max(_FEWEST_PX, round(_HALF * J.shape[1]))
    for c in {0, 1, 2} - {best}:
        y, v = colours[..., c], variance[..., c]
        after, share = _filtered(y, v, colours[..., best], variance[..., best], known, half)
        result[..., c] = np.where(known, after, np.nan)
        left[..., c] *= np.sqrt(share)
    return result, left


def _filtered(
    y: Array, v: Array, x: Array, v_x: Array, known: Mask, half: int
) -> tuple[Array, Array]:
    """Return the channel y (H, W) of variance v, filtered with the guide x of variance v_x, and the share of v left."""
    weight = np.where(known, 1 / (v + np.float32(_FLOOR)), np.float32(0))
    total = box_sum(weight, half) + _TINY

    def mean(values: Array) -> Array:
        return box_sum(weight * values, half) / total

    x_mean, y_mean = mean(x), mean(y)
    xy = mean(x * y) - x_mean * y_mean
    xx = np.maximum(mean(x * x) - x_mean**2, 0)
    alpha = xy / (xx + _ALIKE + mean(v_x))
    rest = np.maximum(mean(y * y) - y_mean**2 - 2 * alpha * xy + alpha**2 * xx, 0)
    noise = np.maximum(mean(v), _TINY)
    kappa = min(1.0, float(np.percentile((rest / noise)[known], _PLAIN)))
    # sums of windows leave rounding errors
    own = np.maximum(mean(np.maximum(rest - kappa * noise, 0)), _TINY)
    plain = mean(alpha) * x + mean(y_mean - alpha * x_mean)
    kept = own / (own + kappa * v)
    return np.asarray(plain + kept * (y - plain)), np.asarray(1 - kappa + kappa * kept)


def box_sum(image: Array, half: int) -> Array:
    """Return the sum over each pixel's square window of 2 half + 1 pixels a side, 0 beyond the image."""
    import cv2

    size = (2 * half + 1, 2 * half + 1)
    return np.asarray(
        cv2.boxFilter(image, -1, size, normalize=False, borderType=cv2.BORDER_CONSTANT)
    )


# -- noisy colours go to the mean ----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class ImagePrior:
    """The mean colour w (3,) of an image, mean and variance of its brightness, and the spread of its reflectances."""

    w: Array
    mean: float
    variance: float
    spread: float = SPREAD

    def posterior(self, J: Array, deviation: Array) -> tuple[Array, Array]:
        """Return the posterior mean and standard deviation (3, P) float32 of colours with standard deviations."""
        shrunk, left = np.empty_like(J, dtype=np.float32), np.empty_like(J, dtype=np.float32)
        for start in range(0, J.shape[1], _BLOCK):
            part = np.s_[:, start : start + _BLOCK]
            few, v = J[part].astype(np.float64), _variance(deviation[part])
            s, noise, bright = self._brightness(few, v)
            c = (self.spread * bright) ** 2
            chroma = c / (c + v)
            shrunk[part] = np.outer(self.w, bright) + chroma * (few - np.outer(self.w, s))
            of_brightness = self.variance * noise / (self.variance + noise)
            left[part] = np.sqrt(np.outer(self.w**2, of_brightness) + chroma * v)
        return shrunk, left

    def _brightness(self, J: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return of each colour (3, P) its brightness s at least 0, the variance of s, and s shrunk to the mean."""
        shrunk = np.full(J.shape[1], self.mean)
        for _ in range(_ROUNDS_OF_S):
            inverse = 1 / (v + (self.spread * shrunk) ** 2)
            weight = self.w**2 @ inverse
            s = ((self.w @ (J * inverse)) / weight).clip(min=0)
            noise = (self.w**2 @ (v * inverse)) / (self.w @ self.w) / weight
            shrunk = self.mean + self.variance / (self.variance + noise) * (s - self.mean)
        return s, noise, shrunk

    def improved(self, J: Array, v: Array) -> ImagePrior:
        """Return the prior after one more round over colours J (3, P) of variance v."""
        s, noise, bright = self._brightness(J, v)
        trust = self.variance / (self.variance + noise)
        mean = float((trust * s).sum() / trust.sum())
        variance = max(
            float((trust * ((s - mean) ** 2 - noise)).sum() / trust.sum()), _LEAST_VARIANCE
        )
        weight = 1 / (v + (self.spread * bright) ** 2)
        w = (bright * J * weight).sum(axis=1).clip(min=0) / (bright**2 * weight).sum(
            axis=1
        ).clip(min=_LEAST_SUM)
        w = w / w.mean() if w.any() else self.w  # a black image has no mean colour
        return ImagePrior(w, mean, variance, self.spread)


def prior_of(J: Array, deviation: Array, spread: float = SPREAD) -> ImagePrior | None:
    """Return the prior of an image from its colours (3, P), each as far as it is known; None where no noise is known.

    deviation: (3, P) standard deviations; spread: of reflectances.
    """
    if not np.isfinite(deviation).any():
        return None
    few = np.s_[:, :: max(1, J.shape[1] // _SAMPLE_OF_PRIOR)]
    J, v = J[few].astype(np.float64), _variance(deviation[few])
    prior = ImagePrior(np.ones(3), float(np.median(J)), 0.05, spread)
    for _ in range(_ROUNDS):
        prior = prior.improved(J, v)
    return prior


def specks_of(J: Array, deviation: Array, *, linear: bool = False) -> Mask:
    """Return which colours (P,) of J (3, P) with standard deviations are too bright for a surface, and above 1.

    They are snow and animals before far ground that too few views show to contradict them. linear: of linear light.
    """
    few = J[:, :: max(1, J.shape[1] // _SAMPLE_OF_PRIOR)]
    times = _TIMES_LINEAR if linear else _TIMES
    most = times * np.quantile(few, _BRIGHTEST, axis=1)[:, None]
    return np.asarray((J - _SURE * deviation > most.clip(min=1)).any(axis=0))


def _variance(deviation: Array) -> Array:
    v = np.where(np.isfinite(deviation), np.square(deviation, dtype=np.float64), _ENDLESS)
    return np.asarray(v.clip(min=_EXACT))
