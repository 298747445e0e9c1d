"""Chooses between stored intensities and linear light (encoding=auto): the one in which the model explains more.

Water acts on light. A camera's files store a curve of it, and the curve is often near sRGB. Where it is, the model
explains linear light better; where the file holds something else, as the demo does, stored intensities. The water is
fitted to equal footprints in both, and the residuals of linear light are divided by the slope of the curve. So both are
in stored units, in which noise is alike.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import NotApplicableError, SolveError
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.methods.sucre.exact import fit
from sucre_bench.methods.sucre.refine_noise import residuals_of
from sucre_bench.methods.sucre.solution import colours_for_water, matched_at, sampled
from sucre_bench.multiview.observations import Observations
from sucre_bench.scene import Scene, View

if TYPE_CHECKING:
    from sucre_bench.methods.sucre.sucre import Sucre

# Linear light is chosen where it leaves less than this share of the residuals of stored intensities. Made scenes in
# linear light had .79 to .89, others 1.3 to 1.6; with uneven light, and on real photographs, both were near 1.
_BETTER = 0.95

# Pixels that both are fitted to, and half the difference of intensities that the slope of the curve is taken over.
_PIXELS, _STEP = 2_000, 0.5 / 255

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

    observations: stored intensities; matched: their sample with equal footprints.
    """
    if matched is None or view.encoding == "linear":
        return NearerEncoding("view")
    few = sampled(matched, _PIXELS, singles=False, seed=0)
    in_linear = replace(options, encoding="linear")
    try:
        stored = _residual(options, few)
        linear = _residual(in_linear, matched_at(in_linear, scene, view, observations, few.pixels))
    except (NotApplicableError, SolveError):
        return NearerEncoding("view")
    if not stored > 0:
        return NearerEncoding("view")
    return NearerEncoding("linear" if linear < _BETTER * stored else "view", linear / stored)


def _residual(options: Sucre, sample: Observations) -> float:
    """Return the median size of studentised residuals in stored units."""
    water = fit(sample, **options.compute).water
    solution = colours_for_water(sample, water, None, options.backend, options.device)
    r, h, _, explained = residuals_of(sample, solution.J, water)
    if options.encoding == "linear":
        r = r / _slope(explained.clip(0, 1))
    return float(np.median(np.abs(r / np.sqrt(1 - h.clip(0, _ALONE)))[h < _ALONE]))


def _slope(linear: Array) -> Array:
    """Return how much linear light changes with the stored intensity."""
    stored = srgb_encode(linear)
    return np.asarray((srgb_decode(stored + _STEP) - srgb_decode(stored - _STEP)) / (2 * _STEP))
