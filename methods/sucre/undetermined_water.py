"""Decides what replaces the fit if the observations do not determine the water."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.machine.compute import Device
from sucre_bench.methods.sucre.diagnostics import is_determined
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.paper import start_of
from sucre_bench.methods.sucre.passes import Backend
from sucre_bench.methods.sucre.solution import Solution, colours_for_water
from sucre_bench.multiview.observations import Observations

# Less optical depth than this over the farthest distances is none. Pure water has as much in red over .2 m.
_CLEAR = 0.05

# A channel is lost if its typical colour has a larger standard deviation than this, the whole scale.
_LOST = 1.0

UNKNOWN_VEIL = (
    "the veil of most channels is not determined, so it stays in the colours as an offset of each channel; "
    "method.display=stretch-1-99 removes it from the picture"
)


DARKEST_AS_VEIL = (
    "the veil is not determined; the darkest colours of each channel were taken for it, so true black may be lighter"
)

# Colours that are darker than the black of a channel, as a share.
_BLACK = 0.005


def without_darkest(solution: Solution) -> tuple[Solution, Array]:
    """Return the solution with the black of each channel subtracted from its colours, and that black (3,).

    An unknown veil at one distance is an offset of each channel. Under water a strobe always makes one.
    """
    black = np.nanquantile(solution.J, _BLACK, axis=1).astype(np.float32)
    solution = replace(solution, J=solution.J - black[:, None], about=solution.about | {"black": black.tolist()})
    return solution.with_limits([DARKEST_AS_VEIL]), black


def has_unknown_veil(solution: Solution) -> bool:
    """Return whether the colours of most channels hold an offset that the observations do not determine."""
    return not solution.is_photograph and not is_determined(solution.uncertainty)


def is_in_air(observations: Observations, solution: Solution) -> bool:
    """Return whether the observations show that no channel is attenuated, so that there is no veil either.

    At least one channel must tell it, by the standard error of its beta: distances that are all alike tell nothing. One
    whose beta is 0, the end of the range, has no standard error.
    """
    far = float(np.quantile(observations.distance, 0.95))
    error = solution.uncertainty.standard_error.beta * far
    known = np.isfinite(error)
    return bool((solution.water.beta * far < _CLEAR).all() and known.any() and (error[known] < _CLEAR).all())


def is_guess(solution: Solution) -> bool:
    """Return whether weak priors decide the water of most channels, and noise fills a channel."""
    lost = np.median(solution.deviation, axis=1) > _LOST
    return not is_determined(solution.uncertainty) and bool(lost.any())


def photograph_as_colours(
    observations: Observations, intensities: Array, solution: Solution, backend: Backend, device: Device
) -> Solution:
    """Return the target's intensities (H W, 3) as the colours, no water, and the limit that says so.

    The standard deviation is that of one observation.
    """
    none = WaterParameters.of_channels(np.zeros((3, 3)))
    without = colours_for_water(observations, none, None, backend, device)
    limit = (
        "these views do not determine the water; the colours are those of the photograph, and the display stretches "
        "them; take views from more distances"
    )
    uncertainty = replace(without.uncertainty, limits=(limit,), is_weak=(True, True, True))
    J = start_of(observations, intensities).astype(np.float32)
    deviation = np.broadcast_to(uncertainty.noise[:, None], J.shape).astype(np.float32)
    about = solution.about | {"solver": "none"}
    return replace(without, J=J, deviation=deviation, uncertainty=uncertainty, about=about, is_photograph=True)
