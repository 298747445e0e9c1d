"""Tells light that falls off across the images, as that of a lamp on the camera does.

A lamp lights the middle of a picture more than its rim. Over flat ground the rim is also farther away, so a fit without
a lamp takes the falloff for attenuation. The falloff moves with the camera, and what views of one point differ by then
follows their places in the image, more than their distances. Here log l is a polynomial of second degree in the place,

    I = l (J a + b),    log l = t1 x + t2 y + t3 x^2 + t4 x y + t5 y^2,

x and y being the ray's x / z and y / z over the largest of them. Gains of views can pass for a falloff, and the
reverse: the one that explains the observations better counts. A falloff is found only to be reported: a lamp (lamp.py)
has a position, and lights the way there too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.methods.sucre.exposure import estimate, random_repeated
from sucre_bench.methods.sucre.light_and_water import Sample, fit_light, promised_noise
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.multiview.observations import Observations

# A falloff counts if it removes at least this share of the residuals. It is fitted if one linear step promises half.
_BETTER = 0.3

# Less falloff than this is none, and beta is not told from it where its standard error over the median distance is
# above this optical depth.
_LEAST, _LOOSE = 0.1, 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Falloff:
    """least: the light at the 1st percentile of the places over that at the 99th; noise, noise_without: rms of the
    residuals with and without it; is_separable: whether distances tell it from attenuation."""

    least: float
    noise: float
    noise_without: float
    is_separable: bool

    @property
    def limit(self) -> str:
        """What to say of it."""
        told = "" if self.is_separable else "distances do not separate it from attenuation, and "
        return (
            f"light falls off across the images, to {self.least:.0%} of its peak, as from a lamp on the camera; "
            f"{told}the fitted water is wrong; use lamp=true"
        )


def find_falloff(observations: Observations, target: str, water: WaterParameters, *, seed: int = 0) -> Falloff | None:
    """Return the falloff that explains the observations clearly better than a water in even light; None without one.

    observations: with `ray` and `view`, of pixels seen more than once; target: name of the restored view; water: fitted
    in even light.
    """
    if observations.ray is None or not observations.n_repeated:
        return None
    few = random_repeated(observations, seed)
    sample = Sample.of(few)
    columns = _columns(few, sample)
    without, promised = promised_noise(sample, columns, water)
    if promised > (1 - _BETTER / 2) * without:
        return None
    found = fit_light(sample, columns, water)
    low, high = np.quantile(np.exp(found.coefficients @ columns), (0.01, 0.99))
    if found.noise > (1 - _BETTER) * without or low > (1 - _LEAST) * high:
        return None
    if found.noise >= estimate(observations, target, water, seed=seed).noise:
        return None
    is_separable = bool((found.error * float(np.median(sample.z)) < _LOOSE).all())
    return Falloff(float(low / high), found.noise, without, is_separable)


def _columns(few: Observations, sample: Sample) -> Array:
    assert few.ray is not None
    x, y = few.ray[:, sample.order].astype(np.float64) / max(float(np.abs(few.ray).max()), 1e-9)
    return np.stack([x, y, x * x, x * y, y * y])
