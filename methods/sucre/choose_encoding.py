"""Chooses between stored intensities and linear light (encoding=auto): the one in which the model explains more.

Water acts on light. A camera's files store a curve of it, and the curve is often near sRGB. Where it is, the model
explains linear light better; where the file holds something else, as the demo does, stored intensities. The water is
fitted to equal footprints in both, and the residuals of linear light are divided by the slope of the curve. So both are
in stored units, in which noise is alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import NotApplicableError, SolveError
from sucre_bench.methods.sucre.exact import fit
from sucre_bench.methods.sucre.refine_noise import decoding_slope, residuals_of
from sucre_bench.methods.sucre.solution import colours_for_water, matched_at, sampled
from sucre_bench.multiview.observations import Observations
from sucre_bench.scene import Scene, View

if TYPE_CHECKING:
    from sucre_bench.methods.sucre.sucre import Sucre

# Linear light is chosen where it leaves less than this share of the residuals of stored intensities. Made scenes in
# linear light had .79 to .89, others 1.3 to 1.6; with uneven light, and on real photographs, both were near 1.
_BETTER = 0.95

# Pixels that both are fitted to.
_PIXELS = 2_000

# Observations that decide their pixel's colour alone have no residual.
_ALONE = 0.9


@dataclass(frozen=True, slots=True)
class NearerEncoding:
    """The encoding that the model explains better; ratio: residuals of linear light over those of stored intensities,
    None if nothing tells."""

    encoding: Literal["view", "linear"]
    ratio: float | None = None


def nearer_encoding(
    options: Sucre, scene: Scene, view: View, observations: Observations, matched: Observations | None
) -> NearerEncoding:
    """Return the encoding in which the water of a view explains more: stored intensities where too few pixels tell.

    observations: stored intensities; matched: their sample with equal footprints. The footprints of linear light are
    means of decoded images: over rough texture, decoded means of stored intensities explain neither encoding.
    """
    if matched is None or view.encoding == "linear":
        return NearerEncoding("view")
    few = sampled(matched, _PIXELS, singles=False, seed=0)
    in_linear = replace(options, encoding="linear")
    try:
        stored = _residual(options, few)
        linear = _residual(options, matched_at(in_linear, scene, view, observations, few.pixels), decoding_slope)
    except (NotApplicableError, SolveError):
        return NearerEncoding("view")
    if not stored > 0:
        return NearerEncoding("view")
    return NearerEncoding("linear" if linear < _BETTER * stored else "view", linear / stored)


def _residual(options: Sucre, sample: Observations, slope: Callable[[Array], Array] = np.ones_like) -> float:
    """Return the median size of studentised residuals in stored units; slope: of intensities by stored ones."""
    water = fit(sample, **options.compute).water
    solution = colours_for_water(sample, water, None, options.backend, options.device)
    r, h, _, explained = residuals_of(sample, solution.J, water)
    r = r / slope(explained.clip(0, 1))
    return float(np.median(np.abs(r / np.sqrt(1 - h.clip(0, _ALONE)))[h < _ALONE]))
