"""Finds light that falls off across the images, as that of a lamp on the camera does, and removes it.

A lamp lights the middle of a picture more than its rim. Over flat ground the rim is also farther away, so a fit without
a lamp takes the falloff for attenuation. The falloff moves with the camera, and what views of one point differ by then
follows their places in the image, more than their distances. Here log l is a polynomial of second degree in the place,

    I = l (J a + b),    log l = t1 x + t2 y + t3 x^2 + t4 x y + t5 y^2,

x and y being the ray's x / z and y / z over the largest of them. Gains of views can pass for a falloff, and the
reverse: the one that explains the observations better counts. The light is 1 where it is brightest, and stays as it is
at the rim of the sample beyond it. The polynomial needs no pose of a lamp, and serves as well where daylight is there
too. A lamp (lamp.py) has a position, and lights the way there too: it explains ground of varying distance better.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.methods.sucre.exposure import estimate
from sucre_bench.methods.sucre.lamp import DARK
from sucre_bench.methods.sucre.light_and_water import ObservationsByPixel, fit_light, promised_noise
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.solution import sampled
from sucre_bench.multiview.observations import Observations

# Pixels that falloff and gains are fitted to, and the fewest that are worth it. Both fits have few unknowns: with 5,000
# pixels they differed by .5 %.
_SAMPLE, _FEWEST = 1_500, 200

# A falloff counts if it removes at least this share of the residuals. It is fitted if one linear step promises half.
_BETTER = 0.3

# lamp=auto removes it if it leaves less than this share of the residuals, and so many views tell it. It left .05 to .24
# on made surveys. In a pool, whose floor is farther at the top of each picture, it left .33 with two views and .42 with
# ten.
_SURE, _FEWEST_VIEWS = 0.3, 3

# The brightest and darkest places count by percentiles.
_ENDS = (0.01, 0.99)

# From here on, a channel may have been cut off.
_FULL = 0.99

_PART = 1 << 16  # observations at a time

# Less falloff than this is none, and beta is not told from it where its standard error over the median distance is
# above this optical depth.
_LEAST, _LOOSE = 0.1, 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Falloff:
    """Light over the places of an image.

    coefficients: (5,) of the polynomial; scale: the largest x / z or y / z of the sample; brightest, darkest: log l at
    the percentiles 99 and 1 of the sample's places; noise, noise_without: rms of the residuals with and without it;
    is_separable: whether distances tell it from attenuation; n_views: number of views in the sample.
    """

    coefficients: Array
    scale: float
    brightest: float
    darkest: float
    noise: float
    noise_without: float
    is_separable: bool
    n_views: int

    @property
    def least(self) -> float:
        """The light at the darkest places over that at the brightest."""
        return float(np.exp(self.darkest - self.brightest))

    @property
    def is_sure(self) -> bool:
        """Whether so much of the residuals is gone that hardly anything else can be the cause."""
        return self.n_views >= _FEWEST_VIEWS and self.noise < _SURE * self.noise_without

    def light(self, ray: Array) -> Array:
        """Return l (...,) in [0.05, 1] along rays (2, ...), x / z and y / z in the camera's frame."""
        log = np.tensordot(self.coefficients, _terms(ray / self.scale), axes=1)
        return np.asarray(np.exp(log.clip(self.darkest, self.brightest) - self.brightest).clip(DARK, 1))


def find_falloff(observations: Observations, target: str, water: WaterParameters, *, seed: int = 0) -> Falloff | None:
    """Return the falloff that explains the observations clearly better than a water in even light; None without one.

    observations: with `ray` and `view`, of pixels seen more than once; target: name of the restored view; water: fitted
    in even light.
    """
    if observations.ray is None:
        return None
    whole = uncut(observations)
    if whole.n_repeated < _FEWEST:
        return None
    few = sampled(whole, _SAMPLE, singles=False, seed=seed)
    assert few.ray is not None
    sample = ObservationsByPixel.of(few)
    scale = max(float(np.abs(few.ray).max()), 1e-9)
    columns = _terms(few.ray[:, sample.pixels.order].astype(np.float64) / scale)
    without, promised = promised_noise(sample, columns, water)
    if promised > (1 - _BETTER / 2) * without:
        return None
    found = fit_light(sample, columns, water)
    darkest, brightest = (float(end) for end in np.quantile(found.coefficients @ columns, _ENDS))
    if found.noise > (1 - _BETTER) * without or np.exp(darkest - brightest) > 1 - _LEAST:
        return None
    if found.noise >= estimate(whole, target, water, seed=seed, most=_SAMPLE).noise:
        return None
    is_separable = bool((found.error * float(np.median(sample.z)) < _LOOSE).all())
    return Falloff(found.coefficients, scale, brightest, darkest, found.noise, without, is_separable, len(few.views))


def uncut(observations: Observations) -> Observations:
    """Return the pixels that no view shows with a channel at the end of the scale, where light is cut off."""
    kept = np.ones(len(observations.pixels), dtype=bool)
    for n, part in observations.slots():
        kept[:n] &= (observations.intensity(part) < _FULL).all(axis=0)
    return observations if kept.all() else observations.take(np.flatnonzero(kept))


def without_falloff(observations: Observations, falloff: Falloff) -> Observations:
    """Return the observations as they would be in even light: I / l (float32, may exceed 1) with l^2 times the weight.

    observations: with `ray`.
    """
    assert observations.ray is not None, "observe with rays"
    n = len(observations)
    colour, weight = np.empty((3, n), dtype=np.float32), np.empty(n, dtype=np.float32)
    for start in range(0, n, _PART):
        part = slice(start, min(start + _PART, n))
        light = falloff.light(observations.ray[:, part].astype(np.float64))
        colour[:, part] = observations.intensity(part) / light
        weight[part] = light * light
    if observations.weight is not None:
        weight *= observations.weight
    return replace(observations, colour=colour, weight=weight)


def _terms(place: Array) -> Array:
    """Return the terms (5, ...) of the polynomial at places (2, ...)."""
    x, y = place
    return np.stack([x, y, x * x, x * y, y * y])
