"""Chooses the pixels that water and light are fitted to."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sucre_bench.multiview.observations import Observations
from sucre_bench.scene import Scene, View

if TYPE_CHECKING:
    from sucre_bench.methods.sucre.sucre import Sucre

# Pixels of the sample: a fit on 5,000 was within 1e-4 of the full cost; four times as many cost little.
SAMPLE = 20_000

# Pixels that the water is fitted to with matched footprints, and the fewest that are worth a fit of their own.
_MATCHED, _FEWEST_MATCHED = 20_000, 200


def sampled(observations: Observations, n: int, *, singles: bool, seed: int) -> Observations:
    """Return n random pixels of those seen more than once, and with `singles` as large a share of the others."""
    rng = np.random.default_rng(seed)
    repeated, all_pixels = observations.n_repeated, len(observations.pixels)
    if n >= repeated:
        return observations.take(np.arange(all_pixels if singles else repeated))
    chosen = [rng.choice(repeated, n, replace=False)]
    if singles:
        share = round((all_pixels - repeated) * n / repeated)
        chosen.append(repeated + rng.choice(all_pixels - repeated, share, replace=False))
    return observations.take(np.sort(np.concatenate(chosen)))


def first_slot(observations: Observations) -> Observations:
    """Return each pixel with its first observation alone, which any water explains: it can only hold a colour up.

    The first that has a weight in all channels: what a lamp leaves in the dark has none.
    """
    n = len(observations.pixels)
    first = np.arange(n)
    if observations.weight is not None:
        for _, part in reversed(list(observations.slots())):
            known = np.flatnonzero(np.atleast_2d(observations.weight[..., part] > 0).all(axis=0))
            first[known] = part.start + known
    return replace(
        observations,
        counts=np.ones(n, dtype=np.int32),
        starts=np.array([0, n]),
        distance=observations.distance[first],
        colour=observations.colour[:, first],
        weight=None if observations.weight is None else observations.weight[..., first],
        view=None,
        ray=None,
    )


def matched_sample(options: Sucre, scene: Scene, view: View, observations: Observations) -> Observations | None:
    """Return a sample with matched footprints (multiview/footprints.py), None where too few pixels have one."""
    from sucre_bench.multiview.footprints import matched_footprints

    n = observations.n_repeated
    if n < _FEWEST_MATCHED:
        return None
    places = np.random.default_rng(options.seed).choice(n, min(n, _MATCHED), replace=False)
    shown = set(observations.views)
    views = [other for other in scene.views if other.name in shown]
    how = options.pairing_with(with_view=True, with_ray=True)
    found = matched_footprints(view, views, observations.pixels[places], **how)
    return found if found.n_repeated >= _FEWEST_MATCHED else None
