"""Chooses the views of a scene that remain around a target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


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
