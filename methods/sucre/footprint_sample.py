"""Chooses the pixels that the water is fitted to with matched footprints (multiview/footprints.py averages them)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sucre_bench.multiview.observations import Observations
from sucre_bench.scene import Scene, View

if TYPE_CHECKING:
    from sucre_bench.methods.sucre.sucre import Sucre

# Pixels that the water is fitted to with matched footprints, and the fewest that are worth a fit of their own.
_MATCHED, _FEWEST_MATCHED = 20_000, 200


def matched_sample(options: Sucre, scene: Scene, view: View, observations: Observations) -> Observations | None:
    """Return the sample with matched footprints; None where too few pixels have one."""
    from sucre_bench.multiview.footprints import matched_footprints

    n = observations.n_repeated
    if n < _FEWEST_MATCHED:
        return None
    places = np.random.default_rng(options.seed).choice(n, min(n, _MATCHED), replace=False)
    shown = set(observations.views)
    views = [other for other in scene.views if other.name in shown]
    how = options.pairing_with(view=True, ray=True)
    found = matched_footprints(view, views, observations.pixels[places], **how)
    return found if found.n_repeated >= _FEWEST_MATCHED else None
