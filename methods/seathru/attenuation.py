"""Attenuation from how the local illuminant fades with distance (Akkaynak & Treibitz 2019, sec. 4.4, eqs. 11, 15-17).

With E the illuminant, -ln E = beta(z) z. beta is either constant or beta(z) = a exp(-b z) + c exp(-d z).
"""

import itertools
from typing import Literal

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.image_formation import TwoTerm

Kind = Literal["two_term", "constant"]

_STEPS = 100  # of distance, a median each
_GREATEST_FACTOR = 100.0  # of a and c, 1/m
_GREATEST_RATE = 100.0  # of b and d, 1/m
_GREATEST_CONSTANT = 5.0  # 1/m, as of the backscatter
_AT_BOUND = 1e-3  # of a bound: fits end this near to it, not on it
_RATES = (0.0, 0.05, 0.2, 0.8, 3.0)
_REFINED = 3
_OUTLIER = 0.1  # in -ln E: beyond 10 % residuals count linearly only


def amplified(beta: TwoTerm, z: Array, amplification: float) -> Array:
    """Return (P,) how much fades up to distances z (P,) metres, and is to be undone: J = D exp(optical depth).

    It is beta(z) z, made to rise with distance: more water never lets more light through, but two fitted terms
    may say so where few pixels are, or where a seabed seen from above fades only a little. It ends at
    ln(amplification).
    """
    at = np.geomspace(z.min(), z.max(), 1024)
    depth = np.maximum.accumulate(beta.optical_depth(at)).clip(max=np.log(amplification))
    return np.interp(z, at, depth).astype(np.float32)


def at_bound(beta: TwoTerm) -> bool:
    """Return whether a fitted factor is the greatest there may be: the light does not say how great it is."""
    greatest = _GREATEST_FACTOR if beta.b or beta.c else _GREATEST_CONSTANT
    return max(beta.a, beta.c) >= (1 - _AT_BOUND) * greatest


def illuminant_by_distance(illuminant: Array, z: Array) -> tuple[Array, Array]:
    """Return the middle distances (K,) of steps of 1 % of the range of z, and the median illuminant (K, 3) in each.

    illuminant: (P, 3); z: (P,) metres. Empty steps are left out. Medians also bear pixels that are black because
    8 bits hold no less.
    """
    order = np.argsort(z, kind="stable")
    near, far = float(z[order[0]]), float(z[order[-1]])
    edges = np.searchsorted(z[order], np.linspace(near, far, _STEPS + 1)[1:-1])
    steps = [step for step in np.split(order, edges) if step.size]
    return (
        np.array([np.median(z[step]) for step in steps], dtype=np.float64),
        np.array([np.median(illuminant[step], axis=0) for step in steps], dtype=np.float64),
    )


def constant_attenuation(z: Array, E: Array) -> float:
    """Return the beta, in [0, 5] 1/m, with the least squares of beta z + ln E; z, E: (K,), E > 0. 0 without any."""
    return float(np.clip(-(z @ np.log(E)) / (z @ z), 0, _GREATEST_CONSTANT)) if z.size else 0.0


def fit_attenuation(z: Array, E: Array, kind: Kind) -> TwoTerm:
    """Fit beta(z) to the illuminant E (K,) > 0 at distances z (K,) in metres.

    What is made small, by robust least squares, is beta(z) z + ln E.
    The publication compares z with -ln E / beta(z): the same zero, but a division by what may be 0. Starts are a grid;
    for each pair of rates the factors follow linearly. Bounds: a, c in [0, 100], b, d in [0, 100] 1/m.
    """
    from scipy.optimize import least_squares, nnls

    if kind == "constant" or not z.size:
        return TwoTerm(constant_attenuation(z, E))

    def residuals(x: Array) -> Array:
        return TwoTerm(*x).optical_depth(z) + np.log(E)

    starts = []
    for b, d in itertools.combinations(_RATES, 2):
        (a, c), misfit = nnls(np.stack([z * np.exp(-b * z), z * np.exp(-d * z)], axis=1), -np.log(E))
        starts.append((misfit, (min(a, _GREATEST_FACTOR), b, min(c, _GREATEST_FACTOR), d)))
    bounds = ([0, 0, 0, 0], [_GREATEST_FACTOR, _GREATEST_RATE, _GREATEST_FACTOR, _GREATEST_RATE])
    fits = [
        least_squares(residuals, start, bounds=bounds, loss="soft_l1", f_scale=_OUTLIER)
        for _, start in sorted(starts)[:_REFINED]
    ]
    return TwoTerm(*(float(x) for x in min(fits, key=lambda fit: fit.cost).x))
