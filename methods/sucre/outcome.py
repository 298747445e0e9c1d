"""From a solution to a restoration: the image, its confidence, and what is worth knowing about the fit."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from sucre_bench.errors import SolveError
from sucre_bench.methods.sucre.solvers import Solution
from sucre_bench.multiview.observations import Observations
from sucre_bench.scene import Array, Restoration, View, Water

__all__ = ["named", "restoration"]


@contextmanager
def named(view: View) -> Iterator[None]:
    """Let a SolveError raised inside say which view it is about."""
    try:
        yield
    except SolveError as fault:
        raise SolveError(f"{view.name}: {fault}") from fault


def restoration(observations: Observations, solution: Solution, **about: Any) -> Restoration:
    """Return the image (H, W, 3), in the encoding of the observations, NaN where the target has no depth.

    confidence: (H, W) standard deviation of J, root mean square over channels. info: cost, sum of squares of each
    channel; negative_share of J in each channel, which is not physical; condition and standard_error of the water,
    noise of each channel, limits in words; steps, n_observations, n_repeated pixels, n_views, unreadable, device.
    """
    trust = solution.trust
    errors = zip(("B", "beta", "gamma"), trust.standard_error.T, strict=True)
    return Restoration(
        observations.image(solution.J),
        water=Water(*solution.water),
        confidence=observations.image(np.sqrt((solution.deviation**2).mean(axis=0))),
        info={
            "cost": solution.cost.tolist(),
            "negative_share": (solution.J < 0).mean(axis=1).tolist(),
            "n_observations": len(observations),
            "n_repeated": observations.n_repeated,
            "n_views": len(observations.views),
            "unreadable": observations.unreadable,
            "noise": _numbers(trust.noise),
            "condition": _numbers(trust.condition),
            "standard_error": {name: _numbers(values) for name, values in errors},
            "limits": list(trust.limits),
            **solution.about,
            **about,
        },
    )


def _numbers(values: Array) -> list[float | None]:
    """Numbers as lists, None for what is not known or not finite."""
    return [float(value) if np.isfinite(value) else None for value in values]
