"""Colours pixels without depth: a distance from the surroundings, the fitted water, the pixel's own intensity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.imaging.encoding import converted
from sucre_bench.imaging.fill import deviation_of_guess, fill_distances, filled_by_water
from sucre_bench.methods.sucre.shrink_noisy_colours import ImagePrior
from sucre_bench.scene import Restoration, View


def fill_pixels_without_depth(
    restoration: Restoration, view: View, prior: ImagePrior | None = None, black: Array | None = None
) -> Restoration:
    """Return a restoration with colours for the pixels without depth, and their confidence, the standard deviation.

    prior: shrinks these colours too, by the error that their guessed distance makes; black: (3,), what was subtracted
    from the other colours. Water, prior and black are of the same encoding, the fitted one.
    """
    z = fill_distances(view)
    holes, water = z > 0, restoration.water
    if water is None or not holes.any():
        return restoration
    J = filled_by_water(view, water, z)[holes].T  # (3, P)
    deviation = deviation_of_guess(J, water, z[holes])
    if black is not None:
        J = J - black[:, None]
    if prior is not None:
        J, deviation = prior.posterior(J, deviation)
    filled = np.full(view.rgb.shape, np.nan, dtype=np.float32)
    filled[holes] = converted(J.T, water.encoding or view.encoding, view.encoding)
    return replace(restoration, filled=filled, confidence=_with_guesses(restoration.confidence, holes, deviation))


def _with_guesses(confidence: Array | None, holes: Mask, deviation: Array) -> Array | None:
    if confidence is None:
        return None
    known = confidence.copy()
    known[holes] = np.sqrt((deviation**2).mean(axis=0))
    return known
