"""Weak priors for channels whose water the observations do not determine.

A fit without priors answers such channels all the same: with a parameter at its bound, or with a value that another
sample of pixels would change by half. Where distances are short or alike, only the product of B and gamma is known.
Then, and only then, a channel is fitted again with two normal priors. They are optical depths over the median distance
d of the observations, so that the scale of the scene does not matter:

    gamma d = beta d  +- 0.5    most waters attenuate and scatter at similar rates (Jerlov's types: a factor of 2)
    beta d  = 0       +- 3      images that show anything have not lost more than exp(-3) of their light

A prior with deviation s adds (noise / s)^2 to the normal equations, noise being that of an observation. Channels that
the data determine stay exactly as they are. A veil that no 8-bit image could show counts as no backscatter: B = 0.
So does the veil of a channel that nothing dims, as in air: no water scatters far more than it attenuates.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.methods.sucre.diagnostics import WaterUncertainty
from sucre_bench.methods.sucre.model import ReducedSystem, veil

# Deviations of the priors, as optical depths.
_ALIKE, _DEPTH = 0.5, 3.0

# A parameter whose standard error is more than this share of its value is not determined.
_LOOSE = 0.5

# Less optical depth than this is none. Pure water has as much in red over .2 m.
_CLEAR = 0.05

# The least veil at the median distance that 8 bits show.
_LEAST_VEIL = 0.5 / 255


def undetermined(rows: Array, uncertainty: WaterUncertainty, free: Mask, dead: Mask, distance: float) -> Mask:
    """Return the channels (3,) with a parameter at a bound or with a large standard error, or without a veil.

    rows: (3 channels, 3) B, beta, gamma; free: (3, 3), parameters that no bound holds; dead: (3,), channels without
    signal, which no prior helps; distance: median, m.
    """
    error = uncertainty.standard_error.by_channel()
    loose = (~free | (error > _LOOSE * np.abs(rows))).any(axis=1) | ~has_veil(rows, distance)
    return np.asarray(loose & ~dead & np.isfinite(uncertainty.noise))


def with_priors(
    evaluate: Callable[[Array], ReducedSystem], noise: Array, distance: float, channels: Mask
) -> Callable[[Array], ReducedSystem]:
    """Return the evaluation with priors on some channels (3,); noise: (3,) of an observation; distance: median, m."""
    scale = np.where(channels, noise * distance, 0)
    J = np.zeros((3, 2, 3))  # of the two prior residuals in B, beta, gamma
    J[:, 0, 1], J[:, 0, 2] = -scale / _ALIKE, scale / _ALIKE
    J[:, 1, 1] = scale / _DEPTH

    def evaluated(rows: Array) -> ReducedSystem:
        residual = np.einsum("ckp,cp->ck", J, rows)
        prior = ReducedSystem(
            np.einsum("cki,ckj->cij", J, J), -np.einsum("cki,ck->ci", J, residual), (residual**2).sum(axis=1)
        )
        return evaluate(rows) + prior

    return evaluated


def is_clear(rows: Array, uncertainty: WaterUncertainty, distance: float) -> Mask:
    """Return the channels (3,) whose attenuation is 0: at that bound, or within its error, if that is small enough.

    distance: median, m. An error that could hide a visible optical depth shows no clear medium, but an unknown one.
    """
    beta, most = rows[:, 1], 2 * uncertainty.standard_error.beta
    return np.asarray((beta == 0) | ((beta <= most) & ((beta + most) * distance < _CLEAR)))


def has_veil(rows: Array, distance: float) -> Mask:
    """Return the channels (3,) whose veil at a distance is more than 8 bits can miss."""
    return np.asarray(veil(np.full(3, distance), rows[:, 0], rows[:, 2]) > _LEAST_VEIL)
