"""What a fit leaves unexplained: the figures of the paper's least-squares and fitting appendices, as a few numbers.

Least squares is the best estimator where residuals r = I - J a - b are normal, of one spread, and free of patterns
(SUCRe, supplementary material, Least squares). Two things are in the way of seeing that in the raw residuals:

- A pixel seen once is explained exactly, whatever the water. Such pixels would make a spike at 0, and are left out.
- A pixel's colour bends to its own observations: with J = sum w a (I - b) / sum w a^2, and normal noise of standard
  deviation sigma, r has sigma sqrt(1 - h), h = w a^2 / sum w a^2 being its leverage. With two to twenty observations a
  pixel a mixture of spreads results, which has heavy tails without any outlier. So it is r / sqrt(1 - h) that is looked
  at, of spread sigma for each (Huber 1981, sec. 7.2). Observations with h > 0.9, near ones beside far ones, decide
  their colour alone; what is left of them is magnified rounding, and they are left out.

Intensities are those that were fitted. Of weighted observations (a lamp's) it is sqrt(w) r; with robust=true all
observations count alike here, so that what was given little weight shows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.methods.sucre.diagnostics import CHANNELS
from sucre_bench.methods.sucre.model import transmission, veil
from sucre_bench.multiview.observations import Indices, Observations

__all__ = ["residuals"]

# How many observations are looked at, and what leverage is too much.
_SAMPLE, _DECISIVE = 200_000, 0.9

# The histogram: bins half a level of 8 bits wide, the middle one around 0, to a quarter of full scale either side.
_BIN, _BINS = 1 / 510, 255

# Where quantiles are taken, in standard deviations of a normal distribution, the x axis of a normal plot.
_Z = np.linspace(-4, 4, 161)

# The density of residuals (to so many standard deviations) over fits, and how many make a bin's quantiles.
_FITS, _RESIDUALS, _REACH, _ENOUGH = 32, 41, 5.0, 30

# Points followed over distance: how many, from the widest ranges of distance, and with how many observations each.
_TRACKS, _WIDEST, _FEWEST, _MOST = 30, 0.05, 4, 16


def residuals(observations: Observations, J: Array, water: Array, seed: int = 0) -> dict[str, Any]:
    """Return numbers that JSON holds, of some 200,000 observations of random pixels that are seen more than once.

    J: (3, P) colours in the order of the store's pixels; water: (3, 3), rows B, beta, gamma.

    observations: how many were looked at; single_share: of all observations, those that are alone at their pixel;
    decisive_share: of those looked at, those left out for their leverage. Where any is left, for each channel: mean,
    std, robust_std (from the median of |r|), skew, kurtosis (excess: 0 for a normal distribution); raw_std, without the
    division by sqrt(1 - h); histogram: counts of bins from -bins width / 2 on, and how many lie beyond; normal: the
    quantiles at probabilities Phi(z); against_fit: counts[fit][residual] over the ranges fit and residual, and in each
    bin of fits the median and the quantiles 0.159 and 0.841, None where there are few. tracks: points seen over wide
    ranges of distance, nearest first: pixel (x, y), J, distance, intensity[channel].
    """
    n_repeated = observations.n_repeated
    n_alone = len(observations.pixels) - n_repeated
    told: dict[str, Any] = {"observations": 0, "single_share": n_alone / len(observations)}
    if not n_repeated:
        return told
    wanted = min(n_repeated, max(1, round(_SAMPLE * n_repeated / (len(observations) - n_alone))))
    places = np.sort(np.random.default_rng(seed).choice(n_repeated, wanted, replace=False))
    few, colours = observations.take(places), J[:, places].astype(np.float64)
    found = _found(few, colours, water.astype(np.float64))
    told |= {"observations": found.n, "decisive_share": 1 - found.r.shape[1] / max(found.n, 1)}
    if not found.r.size:
        return told
    return told | {
        **_moments(found.r),
        "raw_std": _short(found.raw.std(axis=1)),
        "histogram": _histogram(found.r),
        "normal": {"z": _short(_Z), "quantiles": _short(_normal_quantiles(found.r))},
        "against_fit": {name: _density(found.fit[c], found.r[c]) for c, name in enumerate(CHANNELS)},
        "tracks": _tracks(few, colours),
    }


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    """r: (3, M) residuals over sqrt(1 - h); raw: without; fit: (3, M) J a + b; n: observations looked at, M and the
    decisive ones.
    """

    r: Array
    raw: Array
    fit: Array
    n: int


def _found(few: Observations, J: Array, water: Array) -> _Found:
    place = np.concatenate([np.arange(n) for n, _ in few.slots()])
    z = few.distance.astype(np.float64)
    w = np.ones(len(few)) if few.weight is None else few.weight.astype(np.float64)
    B, beta, gamma = (row[:, None] for row in water)
    a, I = transmission(z, beta), few.intensity(slice(None))  # noqa: E741, (3, N)
    fit = J[:, place] * a + veil(z, B, gamma)
    h = w * a**2
    total = np.stack([np.bincount(place, h_c, len(few.pixels)) for h_c in h])
    h = np.divide(h, total[:, place], out=np.ones_like(h), where=total[:, place] > 0)
    kept: Mask = (h < _DECISIVE).all(axis=0) & (w > 0)
    raw = (np.sqrt(w) * (I - fit))[:, kept]
    return _Found(raw / np.sqrt(1 - h[:, kept]), raw, fit[:, kept], int(np.count_nonzero(w)))


def _moments(r: Array) -> dict[str, Any]:
    from scipy.stats import kurtosis, norm, skew

    robust = np.median(np.abs(r), axis=1) / norm.ppf(0.75)
    varies = r.std(axis=1) > 0
    shape = {name: np.full(3, np.nan) for name in ("skew", "kurtosis")}
    for name, moment in (("skew", skew), ("kurtosis", kurtosis)):
        shape[name][varies] = moment(r[varies], axis=1)
    moments = {"mean": r.mean(axis=1), "std": r.std(axis=1), "robust_std": robust, **shape}
    return {name: _short(values) for name, values in moments.items()}


def _histogram(r: Array) -> dict[str, Any]:
    edges = (np.arange(_BINS + 1) - _BINS / 2) * _BIN
    counts = [np.histogram(r_c, edges)[0] for r_c in r]
    beyond = [int(r.shape[1] - c.sum()) for c in counts]
    return {"width": _BIN, "counts": [c.tolist() for c in counts], "beyond": beyond}


def _normal_quantiles(r: Array) -> Array:
    from scipy.stats import norm

    return np.quantile(r, norm.cdf(_Z), axis=1).T


def _density(fit: Array, r: Array) -> dict[str, Any]:
    low, high = np.quantile(fit, (0.001, 0.999))
    fits = np.linspace(low, max(high, low + 1e-3), _FITS + 1)
    reach = _REACH * max(float(r.std()), 1e-4)
    counts, _, _ = np.histogram2d(fit, r, bins=(fits, np.linspace(-reach, reach, _RESIDUALS + 1)))
    bins = np.digitize(fit, fits) - 1
    inside = [r[bins == k] for k in range(_FITS)]
    nothing = np.full(3, np.nan)
    quantiles = [np.quantile(one, (0.159, 0.5, 0.841)) if len(one) >= _ENOUGH else nothing for one in inside]
    ranges = {"fit": _short(fits[[0, -1]]), "residual": _short(np.array([-reach, reach]))}
    lines = dict(zip(("low", "median", "high"), _short(np.transpose(quantiles)), strict=True))
    return ranges | {"counts": counts.astype(int).tolist()} | lines


def _tracks(few: Observations, J: Array) -> list[dict[str, Any]]:
    """Points of all colours among those with the widest ranges of distance."""
    nearest, farthest = np.full((2, len(few.pixels)), few.distance[: len(few.pixels)])
    for n, part in few.slots():
        np.minimum(nearest[:n], few.distance[part], out=nearest[:n])
        np.maximum(farthest[:n], few.distance[part], out=farthest[:n])
    several = np.flatnonzero(few.counts >= min(_FEWEST, few.counts[0]))
    widest = several[np.argsort(-(farthest / nearest)[several], kind="stable")]
    widest = widest[: max(_TRACKS, round(_WIDEST * len(widest)))]
    by_colour = widest[np.argsort(J[:, widest].mean(axis=0), kind="stable")]
    chosen = by_colour[np.unique(np.linspace(0, len(by_colour) - 1, _TRACKS).round().astype(int))]
    return [_track(few, int(place), J[:, place]) for place in chosen]


def _track(few: Observations, place: int, J: Array) -> dict[str, Any]:
    at: Indices = few.starts[: few.counts[place]] + place
    at = at[np.argsort(few.distance[at], kind="stable")]
    at = at[np.unique(np.linspace(0, len(at) - 1, _MOST).round().astype(int))]
    y, x = divmod(int(few.pixels[place]), few.shape[1])
    intensity = few.colour[:, at] * few.scale
    return {"pixel": [x, y], "J": _short(J), "distance": _short(few.distance[at]), "intensity": _short(intensity)}


def _short(values: Array) -> Any:
    """Numbers as lists, five digits of each, None for NaN."""
    if values.ndim > 1:
        return [_short(row) for row in values]
    return [float(f"{value:.5g}") if np.isfinite(value) else None for value in values]
