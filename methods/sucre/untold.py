"""What to do where the observations do not tell the water, and the least-squares fit is an accident."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.machine.cores import Device
from sucre_bench.methods.sucre.diagnostics import is_told
from sucre_bench.methods.sucre.kernels import Backend
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.solvers import Solution, colours_for_water, start_of
from sucre_bench.multiview.observations import Observations

__all__ = ["explains_better", "is_made_up", "left_as_photographed"]

# Gains of views are believed where they take at least this share of the noise away, and where attenuation falls: it had
# passed for them. Under a lamp that moves with the camera gains take noise away, too, but attenuation rises.
_BETTER = 0.3

# A channel whose typical colour has a larger standard deviation than this is lost: it is the whole scale.
_LOST = 1.0

_LIMIT = "the water cannot be told from these views; colours are left as photographed"


def explains_better(with_gains: Solution, without: Solution) -> bool:
    """Return whether gains of views explain the observations clearly better than one exposure does.

    Both hold `unexplained`, the standard deviation of residuals over matched footprints, in `about`.
    """
    calmer = with_gains.about["unexplained"] < (1 - _BETTER) * without.about["unexplained"]
    return bool(calmer and with_gains.water.beta.sum() < without.water.beta.sum())


def is_made_up(solution: Solution) -> bool:
    """Return whether the water is a guess that loses a channel: most channels are weak, and noise fills one."""
    lost = np.median(solution.deviation, axis=1) > _LOST
    return not is_told(solution.uncertainty) and bool(lost.any())


def left_as_photographed(
    observations: Observations, intensities: Array, solution: Solution, backend: Backend, device: Device
) -> Solution:
    """Return the target's intensities (H W, 3) as the colours, no water, and the limit that says so."""
    none = WaterParameters.of_channels(np.zeros((3, 3)))
    kept = colours_for_water(observations, none, None, backend, device)
    uncertainty = replace(kept.uncertainty, limits=(_LIMIT,), is_weak=(True, True, True))
    J = start_of(observations, intensities).astype(np.float32)
    return replace(kept, J=J, uncertainty=uncertainty, about=solution.about | {"solver": "none"})
