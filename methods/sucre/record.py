"""Makes a restoration of a solution: the image, its confidence, and the record of the fit with its residuals.

Residual statistics are the figures of the paper's least-squares and fitting appendices, as a few numbers.

Least squares is the best estimator where residuals r = I - J a - b are normal, of one spread, and free of patterns
(SUCRe, supplementary material, Least squares). Raw residuals hide this for two reasons:

- A pixel seen once is explained exactly by any water. Such pixels would make a spike at 0, and are left out.
- A pixel's colour follows its own observations. With J = sum w a (I - b) / sum w a^2 and normal noise of standard
  deviation sigma, r has sigma sqrt(1 - h), where h = w a^2 / sum w a^2 is its leverage. Two to twenty observations a
  pixel give a mixture of spreads, which has heavy tails without any outlier. So the statistics are of r / sqrt(1 - h),
  which has spread sigma everywhere (Huber 1981, sec. 7.2). Observations with h > 0.9, near ones beside far ones, decide
  their colour alone. Their residual is magnified rounding, and they are left out.

Intensities are those that were fitted. For weighted observations (light was removed) the residual is sqrt(w) r. Under
robust=true all observations count alike here, so that those with little weight show.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Indices, evenly
from sucre_bench.errors import SolveError
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.residuals import residuals_of
from sucre_bench.methods.sucre.solution import MOST_NEGATIVE, Solution
from sucre_bench.methods.sucre.uncertainty import (
    CHANNELS,
    WaterUncertainty,
    errors_said,
    is_determined,
    roughly_known,
)
from sucre_bench.multiview.observations import Observations
from sucre_bench.plugins.call_method import is_stored_in_full
from sucre_bench.scene import Encoding, Restoration, View, Water

# The share of an image's colours from which on a fault is reported.
_MANY = 0.1

# The quantile of distances that counts as far ground.
_FAR_GROUND = 0.95

# What a limit has that a user can act on.
_TYPED = re.compile(r"\b(method|\w+\.\w+)=\w|out of the dataset")

UNDETERMINED = (
    "the views do not determine the water, so colours may be wrong; use method=dive_gray_world, or "
    "photographs from more distances"
)

# Number of observations used, and the largest leverage.
_SAMPLE = 50_000
_DECISIVE = 0.9

# The histogram: bins half a level of 8 bits wide, the middle one around 0, to a quarter of full scale either side.
_BIN = 1 / 510
_BINS = 255

# Places of the quantiles, in standard deviations of a normal distribution: the x axis of a normal plot.
_Z = np.linspace(-4, 4, 161)

# Density of residuals over fits: bins of each, reach in standard deviations, fewest residuals for a bin's quantiles.
_FITS = 32
_RESIDUALS = 41
_REACH = 5.0
_ENOUGH = 30

# Points followed over distance: their number, the share of widest ranges, fewest and most observations of each.
_TRACKS = 30
_WIDEST = 0.05
_FEWEST = 4
_MOST = 16


@contextmanager
def named(view: View) -> Iterator[None]:
    """Add the view's name to a SolveError raised inside."""
    try:
        yield
    except SolveError as fault:
        raise type(fault)(f"{view.name}: {fault}") from fault


def with_residuals(observations: Observations, solution: Solution) -> Solution:
    """Add residual statistics (see `residuals`) to the course, if all of the result is wanted."""
    if not is_stored_in_full():
        return solution
    return solution.decided(residuals=residuals(observations, solution.J, solution.water))


def restoration(
    observations: Observations,
    solution: Solution,
    stage_seconds: Mapping[str, float],
    options: Any,
    encoding: Encoding | None = None,
) -> Restoration:
    """Return the image (H, W, 3), NaN where the target has no depth.

    stage_seconds: of "pair", also when an earlier run did the pairing, and of "solve".
    options: of the method; encoding: of the fitted intensities, where it is not the view's.

    confidence: (H, W) standard deviation of J, root mean square over channels. info: cost, sum of squares of each
    channel; negative_share of J in each channel (negative colours are not physical); below_zero: channels where it is
    more than the judge admits; n_specks, pixels whose colour is
    too bright for a surface; condition and standard_error of the water, noise of each channel, limits in words; hints:
    what a user can do; veil_known: whether no weak prior decides the water of most channels; assumed: channels that one
    decides; roughly_known: channels with a large standard error; far_error: of each channel's colours on far ground, a
    share; steps,
    n_observations, n_repeated pixels, n_views, unreadable, device.
    """
    uncertainty = solution.uncertainty
    deviation = (
        solution.deviation if solution.growth is None else solution.deviation * solution.growth
    )
    negative = (solution.J < 0).mean(axis=1)
    unknown = (solution.deviation > 1).mean(axis=1)
    far = float(np.quantile(observations.distance, _FAR_GROUND))
    limits = [
        *uncertainty.limits,
        *errors_said(solution.water, uncertainty, far),
        *faults_of_colours(negative, unknown, options),
    ]
    info = {
        "cost": solution.cost,
        "negative_share": negative,
        "below_zero": [
            name
            for name, share in zip(CHANNELS, negative, strict=True)
            if share > MOST_NEGATIVE
        ],
        "n_specks": int(np.isnan(solution.J).any(axis=0).sum()),
        "n_observations": len(observations),
        "n_repeated": observations.n_repeated,
        "n_views": len(observations.views),
        "unreadable": (*observations.unreadable, *observations.grey),
        "noise": uncertainty.noise,
        "condition": uncertainty.condition,
        "standard_error": uncertainty.standard_error,
        "limits": limits,
        "hints": hints(limits, uncertainty),
        "veil_known": is_determined(uncertainty),
        "assumed": [
            name for name, is_weak in zip(CHANNELS, uncertainty.is_weak, strict=True) if is_weak
        ],
        "roughly_known": roughly_known(solution.water, uncertainty),
        "far_error": dict(zip(CHANNELS, uncertainty.standard_error.beta * far, strict=True)),
        **plain(solution.course),
        "stage_seconds": stage_seconds,
    }
    water = Water(solution.water.B, solution.water.beta, solution.water.gamma, encoding)
    confidence = observations.image(np.sqrt((deviation**2).mean(axis=0)))
    return Restoration(
        observations.image(solution.J), water=water, confidence=confidence, info=plain(info)
    )


def plain(value: Any) -> Any:
    """Return typed data as plain data for JSON: without fields that are None, numbers None where not finite."""
    if is_dataclass(value):
        found = {field.name: getattr(value, field.name) for field in fields(value)}
        return {name: plain(one) for name, one in found.items() if one is not None}
    if isinstance(value, Mapping):
        return {name: plain(one) for name, one in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def unknown_veil() -> str:
    """Return the limit of a water that does not determine the veil of most channels."""
    fault = "the veil of most channels is not determined, so it stays in the colours"
    remedy = "method.display=stretch-1-99 removes it from the picture"
    return f"{fault} as an offset of each channel; {remedy}"


def hints(limits: Sequence[str], uncertainty: WaterUncertainty) -> list[str]:
    """Return what a user can type: the limits that name an option or a method, after what matters most."""
    return [
        *(() if is_determined(uncertainty) else (UNDETERMINED,)),
        *filter(_TYPED.search, limits),
    ]


def faults_of_colours(negative: Array, unknown: Array, options: Any) -> list[str]:
    """Describe faults of the colours, and the word that mends each with these options of a method.

    negative: (3,) share below zero; unknown: (3,) share with a standard deviation above 1.
    """
    doubts = []
    fits_water = getattr(options, "water", "own") in ("own", "shared")
    for colour, below, lost in zip(CHANNELS, negative, unknown, strict=True):
        for share, fault, option, effect, helps in (
            (
                below,
                "darker than black, and show as black",
                "physical",
                "keeps them above zero",
                fits_water,
            ),
            (lost, "lost in noise", "refine", "draws them to the mean", True),
        ):
            if share > _MANY:
                word = (
                    f"method.{option}=true" if hasattr(options, option) else "method=sucre_plus"
                )
                remedy = (
                    f"; {word} {effect}"
                    if helps and getattr(options, option, False) is not True
                    else ""
                )
                doubts.append(f"{colour}: {share:.0%} of the colours are {fault}{remedy}")
    return doubts


def residuals(observations: Observations, J: Array, water: WaterParameters) -> dict[str, Any]:
    """Return statistics of some 50,000 observations of random pixels that are seen more than once, ready for JSON.

    J: (3, P) colours in the order of `observations.pixels`.

    observations: how many were used. If any is left, for each channel: mean, std, robust_std (from the median of |r|),
    skew, kurtosis (excess: 0 for a normal distribution); histogram: counts of bins from -bins width / 2 on, and the
    number beyond; normal: the quantiles at probabilities Phi(z); against_fit: counts[fit][residual] over the ranges fit
    and residual, and for each bin of fits the median and the quantiles 0.159 and 0.841, None for bins with few. tracks:
    points seen over wide ranges of distance, nearest first: pixel (x, y), J, distance, intensity[channel].
    """
    from scipy.special import ndtr, ndtri

    n_repeated = observations.n_repeated
    if not n_repeated:
        return {"observations": 0}
    n_alone = len(observations.pixels) - n_repeated
    wanted = min(
        n_repeated, max(1, round(_SAMPLE * n_repeated / (len(observations) - n_alone)))
    )
    places = np.sort(np.random.default_rng(0).choice(n_repeated, wanted, replace=False))
    few, colours = observations.take(places), J[:, places].astype(np.float64)
    raw, h, information, fit = residuals_of(few, colours, water)
    kept = (information > 0).all(axis=0) & (h < _DECISIVE).all(axis=0)
    about: dict[str, Any] = {"observations": int(kept.sum())}
    if not kept.any():
        return about
    r = raw[:, kept] / np.sqrt(1 - h[:, kept])
    fit = fit[:, kept]
    mean, std = r.mean(axis=1), r.std(axis=1)
    standard = np.divide(
        r - mean[:, None], std[:, None], out=np.full_like(r, np.nan), where=std[:, None] > 0
    )
    edges = (np.arange(_BINS + 1) - _BINS / 2) * _BIN
    counts = np.stack([np.histogram(r_c, edges)[0] for r_c in r])
    beyond = r.shape[1] - counts.sum(axis=1)
    return about | {
        "mean": _short(mean),
        "std": _short(std),
        "robust_std": _short(np.median(np.abs(r), axis=1) / ndtri(0.75)),
        "skew": _short((standard**3).mean(axis=1)),
        "kurtosis": _short((standard**4).mean(axis=1) - 3),
        "histogram": {"width": _BIN, "counts": counts.tolist(), "beyond": beyond.tolist()},
        "normal": {"z": _short(_Z), "quantiles": _short(np.quantile(r, ndtr(_Z), axis=1).T)},
        "against_fit": {name: _density(fit[c], r[c]) for c, name in enumerate(CHANNELS)},
        "tracks": _tracks(few, colours),
    }


def _density(fit: Array, r: Array) -> dict[str, Any]:
    low, high = np.quantile(fit, (0.001, 0.999))
    fits = np.linspace(low, max(high, low + 1e-3), _FITS + 1)
    reach = _REACH * max(float(r.std()), 1e-4)
    counts, _, _ = np.histogram2d(
        fit, r, bins=(fits, np.linspace(-reach, reach, _RESIDUALS + 1))
    )
    bins = np.digitize(fit, fits) - 1
    inside = [r[bins == k] for k in range(_FITS)]
    nothing = np.full(3, np.nan)
    quantiles = [
        np.quantile(one, (0.159, 0.5, 0.841)) if len(one) >= _ENOUGH else nothing
        for one in inside
    ]
    ranges = {"fit": _short(fits[[0, -1]]), "residual": _short(np.array([-reach, reach]))}
    lines = dict(zip(("low", "median", "high"), _short(np.transpose(quantiles)), strict=True))
    return ranges | {"counts": counts.astype(int).tolist()} | lines


def _tracks(few: Observations, J: Array) -> list[dict[str, Any]]:
    """Points of all colours among those with the widest ranges of distance."""
    nearest, farthest = few.distance_range()
    several = np.flatnonzero(few.counts >= min(_FEWEST, few.counts[0]))
    widest = several[np.argsort(-(farthest / nearest)[several], kind="stable")]
    widest = widest[: max(_TRACKS, round(_WIDEST * len(widest)))]
    by_colour = widest[np.argsort(J[:, widest].mean(axis=0), kind="stable")]
    chosen = by_colour[evenly(len(by_colour), _TRACKS)]
    return [_track(few, int(place), J[:, place]) for place in chosen]


def _track(few: Observations, place: int, J: Array) -> dict[str, Any]:
    at: Indices = few.starts[: few.counts[place]] + place
    at = at[np.argsort(few.distance[at], kind="stable")]
    at = at[evenly(len(at), _MOST)]
    y, x = divmod(int(few.pixels[place]), few.shape[1])
    intensity = few.colour[:, at] * few.scale
    return {
        "pixel": [x, y],
        "J": _short(J),
        "distance": _short(few.distance[at]),
        "intensity": _short(intensity),
    }


def _short(values: Array) -> Any:
    """Numbers as lists, five digits of each, None for NaN."""
    return plain(np.vectorize(lambda value: float(f"{value:.5g}"), otypes=[float])(values))
