"""Makes a restoration of a solution: the image, its confidence, and the record of the fit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import SolveError
from sucre_bench.machine.progress import say
from sucre_bench.methods.sucre.diagnostics import CHANNELS
from sucre_bench.methods.sucre.residuals import residuals
from sucre_bench.methods.sucre.solvers import Solution
from sucre_bench.methods.sucre.sucre import typed
from sucre_bench.multiview.observations import Observations
from sucre_bench.plugins.call_method import with_name
from sucre_bench.scene import Encoding, Restoration, View, Water

# The share of an image's colours from which on a fault is reported.
_MANY = 0.1


@contextmanager
def named(view: View) -> Iterator[None]:
    """Add the view's name to a SolveError raised inside."""
    try:
        yield
    except SolveError as fault:
        raise type(fault)(f"{view.name}: {fault}") from fault


def with_residuals(observations: Observations, solution: Solution) -> Solution:
    """Add residual statistics (residuals.py) to `solution.about`."""
    statistics = residuals(observations, solution.J, solution.water)
    return replace(solution, about=solution.about | {"residuals": statistics})


def restoration(
    view: View,
    observations: Observations,
    solution: Solution,
    stage_seconds: Mapping[str, float],
    options: Any,
    encoding: Encoding | None = None,
) -> Restoration:
    """Return the image (H, W, 3), NaN where the target has no depth.

    stage_seconds: of "pair", also when an earlier run did the pairing, and of "solve".
    options: of the method, which limits name; encoding: of the fitted intensities, where it is not the view's.

    confidence: (H, W) standard deviation of J, root mean square over channels. info: cost, sum of squares of each
    channel; negative_share of J in each channel (negative colours are not physical); condition and standard_error of
    the water, noise of each channel, limits in words; veil_known: whether no weak prior decides the
    water of a channel; steps, n_observations, n_repeated pixels, n_views, unreadable,
    device.
    """
    water, uncertainty = solution.water, solution.uncertainty
    negative = (solution.J < 0).mean(axis=1)
    unknown = (solution.deviation > 1).mean(axis=1)
    name = type(options).__plugin__.name
    limits = [with_name(limit, name) for limit in (*uncertainty.limits, *faults_of_colours(negative, unknown, options))]
    for limit in limits:
        say(f"{view.name}: {limit}")
    return Restoration(
        observations.image(solution.J),
        water=Water(water.B, water.beta, water.gamma, encoding),
        confidence=observations.image(np.sqrt((solution.deviation**2).mean(axis=0))),
        info={
            "cost": solution.cost.tolist(),
            "negative_share": negative.tolist(),
            "n_observations": len(observations),
            "n_repeated": observations.n_repeated,
            "n_views": len(observations.views),
            "unreadable": observations.unreadable,
            "noise": _numbers(uncertainty.noise),
            "condition": _numbers(uncertainty.condition),
            "standard_error": {
                name: _numbers(getattr(uncertainty.standard_error, name)) for name in ("B", "beta", "gamma")
            },
            "limits": limits,
            "veil_known": not any(uncertainty.is_weak),
            **solution.about,
            "stage_seconds": dict(stage_seconds),
        },
    )


def faults_of_colours(negative: Array, unknown: Array, options: Any) -> list[str]:
    """Describe faults of the colours, and the word that mends each with these options of a method.

    negative: (3,) share below zero; unknown: (3,) share with a standard deviation above 1.
    """
    doubts = []
    for colour, below, lost in zip(CHANNELS, negative, unknown, strict=True):
        for share, fault, option, effect in (
            (below, "negative", "physical", "keeps them above zero"),
            (lost, "lost in noise", "refine", "draws them to the mean"),
        ):
            if share > _MANY:
                word = typed(options, option, True) if hasattr(options, option) else "method=sucre_plus"
                remedy = f"; {word} {effect}" if word else ""
                doubts.append(f"{colour}: {share:.0%} of the colours are {fault}{remedy}")
    return doubts


def _numbers(values: Array) -> list[float | None]:
    """Numbers as a list, None where not finite."""
    return [float(value) if np.isfinite(value) else None for value in values]
