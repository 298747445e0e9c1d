"""Chooses the views that remain around a target: `within` and `keep`."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from sucre_bench.degrade.options import Degradation, hashed
from sucre_bench.degrade.random_numbers import generator
from sucre_bench.scene import Scene, View


def around(scene: Scene, target: View, degradation: Degradation) -> Scene:
    """Return a scene with only the views that `within` and `keep` leave around a target."""
    if not degradation.chooses_views:
        return scene
    names = [view.name for view in scene.views]
    rng = generator(degradation.seed, scene.name, target.name, "keep")
    kept = kept_views(names, target.name, degradation.within, degradation.keep, rng)
    if len(kept) == len(names):
        return scene
    views = [scene.views[place] for place in kept]
    return dataclasses.replace(
        scene, views=views, data_id=hashed(scene.data_id, "views", [view.name for view in views])
    )


def kept_views(
    names: Sequence[str], target: str, within: int | None, keep: int | None, rng: np.random.Generator
) -> list[int]:
    """Return the places of the remaining views in capture order, with the target's.

    names: of all views in capture order; within: frames that remain before and after the target; keep: number of views
    that remain of those, drawn at random, the target included. With the same seed, a smaller `keep` gives a subset of a
    larger one.
    """
    at = names.index(target)
    first, last = (0, len(names) - 1) if within is None else (at - within, at + within)
    others = [place for place in range(max(0, first), min(len(names), last + 1)) if place != at]
    if keep is not None:
        others = [others[n] for n in rng.permutation(len(others))[: keep - 1]]
    return sorted([at, *others])
