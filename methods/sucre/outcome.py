"""From a solution to a restoration: the image, its confidence, and what is worth knowing about the fit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import SolveError
from sucre_bench.machine.progress import say
from sucre_bench.methods.sucre.diagnostics import CHANNELS
from sucre_bench.methods.sucre.residuals import residuals
from sucre_bench.methods.sucre.solvers import Solution
from sucre_bench.multiview.observations import Observations
from sucre_bench.scene import Encoding, Restoration, View, Water

# From this share of an image's colours on it is worth a word.
_MANY = 0.1

__all__ = ["named", "restoration", "with_residuals"]


@contextmanager
def named(view: View) -> Iterator[None]:
    """Let a SolveError raised inside say which view it is about."""
    try:
        yield
    except SolveError as fault:
        raise type(fault)(f"{view.name}: {fault}") from fault


def with_residuals(observations: Observations, solution: Solution, seed: int = 0) -> Solution:
    """Return the solution with what it leaves of its observations, see residuals.py, in what is told about it."""
    left = residuals(observations, solution.J, solution.water, seed)
    return replace(solution, about=solution.about | {"residuals": left})


def restoration(
    view: View,
    observations: Observations,
    solution: Solution,
    stage_seconds: Mapping[str, float],
    encoding: Encoding | None = None,
) -> Restoration:
    """Return the image (H, W, 3), NaN where the target has no depth.

    stage_seconds: of "pair", whenever that was done and by whichever method, and of "solve"; together they are what the
    restoration took. encoding: of the intensities that were fitted, where that is not the view's.

    confidence: (H, W) standard deviation of J, root mean square over channels. info: cost, sum of squares of each
    channel; negative_share of J in each channel, which is not physical; condition and standard_error of the water,
    noise of each channel, limits in words; steps, n_observations, n_repeated pixels, n_views, unreadable, device.
    """
    trust, (B, beta, gamma) = solution.trust, solution.water
    negative = (solution.J < 0).mean(axis=1)
    unknown = (solution.deviation > 1).mean(axis=1)
    limits = [*trust.limits, *_doubts(negative, unknown)]
    for limit in limits:
        say(f"{view.name}: {limit}")
    errors = zip(("B", "beta", "gamma"), trust.standard_error.T, strict=True)
    return Restoration(
        observations.image(solution.J),
        water=Water(B, beta, gamma, encoding),
        confidence=observations.image(np.sqrt((solution.deviation**2).mean(axis=0))),
        info={
            "cost": solution.cost.tolist(),
            "negative_share": negative.tolist(),
            "n_observations": len(observations),
            "n_repeated": observations.n_repeated,
            "n_views": len(observations.views),
            "unreadable": observations.unreadable,
            "noise": _numbers(trust.noise),
            "condition": _numbers(trust.condition),
            "standard_error": {name: _numbers(values) for name, values in errors},
            "limits": limits,
            **solution.about,
            "stage_seconds": dict(stage_seconds),
            "seconds": stage_seconds["pair"] + stage_seconds["solve"],
        },
    )


def _doubts(negative: Array, unknown: Array) -> list[str]:
    """What is wrong with colours, from the shares (3,) of those below zero and of those known no better than to 1."""
    said = []
    for colour, below, lost in zip(CHANNELS, negative, unknown, strict=True):
        if below > _MANY:
            said.append(f"{colour}: {below:.0%} of the colours are negative; physical=true keeps them above zero")
        if lost > _MANY:
            said.append(f"{colour}: {lost:.0%} of the colours are lost in noise; prior=true draws them to the mean")
    return said


def _numbers(values: Array) -> list[float | None]:
    """Numbers as lists, None for what is not known or not finite."""
    return [float(value) if np.isfinite(value) else None for value in values]
