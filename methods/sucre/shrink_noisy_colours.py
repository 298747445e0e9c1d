"""Shrink noisy colours towards the image's mean colour at their own brightness (empirical Bayes).

Little light arrives from far away, and dividing by a small transmission magnifies the noise. Water takes red first, so
red is lost where green and blue are still known. Three means, one a channel, would then paint dark places red: the mean
of red beside a green and a blue near 0. The three channels of a surface are alike, so they are shrunk together.

A colour is its brightness s times a reflectance that differs little from the image's mean w (mean of channels 1):

    J = s (w + e),    e normal with deviation d in each channel,    s normal with mean s0 and deviation S.

With the variance v of J and c = (d s)^2, the best brightness and colour are

    s = (sum w J / (v + c)) / (sum w^2 / (v + c)),    J' = s' w + c / (c + v) (J - s w),

where s' is s, shrunk towards s0 by its own variance (Efron & Morris 1973). Channels that are known give the brightness,
and a channel that is lost follows it. A dark pixel has little chroma, a bright one as much as it shows. w, d, s0
and S come from the image itself, d being at least LEAST_SPREAD: most images are almost gray, and few things in them
have colours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array

# Least deviation of reflectances. Less of it helps made scenes as shown, more of it charts: docs/sucre.md has figures.
LEAST_SPREAD = 0.2

# The same in linear light: sRGB's curve raises bright intensities to nearly the power 2.4, which multiplies relative
# deviations by as much. A photograph agreed.
LEAST_SPREAD_LINEAR = 2.4 * LEAST_SPREAD

_ROUNDS, _ROUNDS_OF_S = 30, 4

# Pixels that the mean colour is estimated from, and pixels that are worked on at a time.
_SAMPLE, _BLOCK = 20_000, 1 << 15

# Least variance of the brightness of an image, .01 squared: with less, all pixels would become equally bright.
_LEAST = 1e-4

# Variances of a colour that is known as well as can be, and of one without any information.
_EXACT, _ENDLESS = 1e-7, 1e12


def posterior(J: Array, deviation: Array) -> tuple[Array, Array]:
    """Return the posterior mean and standard deviation (3, P) float32 of colours J with standard deviations, (3, P)."""
    prior = prior_of(J, deviation)
    return (J, deviation) if prior is None else prior.posterior(J, deviation)


def _variance(deviation: Array) -> Array:
    v = np.where(np.isfinite(deviation), np.square(deviation, dtype=np.float64), _ENDLESS)
    return np.asarray(v.clip(min=_EXACT))


@dataclass(frozen=True, slots=True, eq=False)
class ImagePrior:
    """The mean colour w (3,) of an image, mean and variance of its brightness, and the spread of its reflectances."""

    w: Array
    mean: float
    variance: float
    spread: float = LEAST_SPREAD

    def brightness(self, J: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return of each colour (3, P) its brightness s at least 0, the variance of s, and s shrunk to the mean."""
        shrunk = np.full(J.shape[1], self.mean)
        for _ in range(_ROUNDS_OF_S):
            inverse = 1 / (v + (self.spread * shrunk) ** 2)
            weight = self.w**2 @ inverse
            s = ((self.w @ (J * inverse)) / weight).clip(min=0)
            noise = (self.w**2 @ (v * inverse)) / (self.w @ self.w) / weight
            shrunk = self.mean + self.variance / (self.variance + noise) * (s - self.mean)
        return s, noise, shrunk

    def posterior(self, J: Array, deviation: Array) -> tuple[Array, Array]:
        """Return the posterior mean and standard deviation (3, P) float32 of colours with standard deviations."""
        shrunk, left = np.empty_like(J, dtype=np.float32), np.empty_like(J, dtype=np.float32)
        for start in range(0, J.shape[1], _BLOCK):
            part = np.s_[:, start : start + _BLOCK]
            shrunk[part], left[part] = self._shrunk(J[part].astype(np.float64), _variance(deviation[part]))
        return shrunk, left

    def _shrunk(self, J: Array, v: Array) -> tuple[Array, Array]:
        """Return colours (3, P) and their standard deviations."""
        s, noise, bright = self.brightness(J, v)
        c = (self.spread * bright) ** 2
        chroma = c / (c + v)
        left = np.outer(self.w**2, self.variance * noise / (self.variance + noise)) + chroma * v
        return np.outer(self.w, bright) + chroma * (J - np.outer(self.w, s)), np.sqrt(left)


def prior_of(J: Array, deviation: Array, least_spread: float = LEAST_SPREAD) -> ImagePrior | None:
    """Return the prior of an image from its colours (3, P), each as far as it is known; None where no noise is known.

    deviation: (3, P) standard deviations; least_spread: of reflectances.
    """
    if not np.isfinite(deviation).any():
        return None
    few = np.s_[:, :: max(1, J.shape[1] // _SAMPLE)]
    return _estimated(J[few].astype(np.float64), _variance(deviation[few]), least_spread)


def _estimated(J: Array, v: Array, least_spread: float) -> ImagePrior:
    prior = ImagePrior(np.ones(3), float(np.median(J)), 0.05, least_spread)
    for _ in range(_ROUNDS):
        s, noise, bright = prior.brightness(J, v)
        trust = prior.variance / (prior.variance + noise)
        mean = float((trust * s).sum() / trust.sum())
        variance = max(float((trust * ((s - mean) ** 2 - noise)).sum() / trust.sum()), _LEAST)
        weight = 1 / (v + (prior.spread * bright) ** 2)
        power = (bright**2 * weight).sum(axis=1)
        if not power.all():  # a black image has no mean colour
            return prior
        w = (bright * J * weight).sum(axis=1) / power
        w = w.clip(min=0) / w.clip(min=0).mean() if (w > 0).any() else prior.w
        prior = ImagePrior(w, mean, variance, max(prior.spread * _misfit(prior, J, s, weight), least_spread))
    return prior


def _misfit(prior: ImagePrior, J: Array, s: Array, weight: Array) -> float:
    """Return how much larger deviations from the mean colour are than expected: of three channels, two are free."""
    chi = (weight * (J - np.outer(prior.w, s)) ** 2).sum(axis=0)
    known = weight.sum(axis=0) >= np.median(weight.sum(axis=0))  # pixels whose noise does not hide reflectances
    lit = known & (s >= prior.mean)  # shade has offsets of the water, which are no reflectances
    return float(np.sqrt(chi[lit].mean() / 2).clip(0.5, 2)) if lit.any() else 1.0
