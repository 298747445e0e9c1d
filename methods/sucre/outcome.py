"""From a solution to a restoration: the image, its confidence, and what is worth knowing about the fit."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from sucre_bench.errors import SolveError
from sucre_bench.methods.sucre.solvers import Solution
from sucre_bench.multiview.observations import Observations
from sucre_bench.scene import Restoration, View, Water

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
    known: dict[str, Any] = {}
    if trust is not None:
        errors = dict(zip(("B", "beta", "gamma"), np.nan_to_num(trust.standard_error.T).tolist(), strict=True))
        known = {
            "noise": trust.noise.tolist(),
            "condition": trust.condition.tolist(),
            "standard_error": errors,
            "limits": list(trust.limits),
        }
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
            **known,
            **solution.about,
            **about,
        },
    )
