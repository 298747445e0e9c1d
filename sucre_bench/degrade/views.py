"""Fewer views: which ones of a scene a target is seen with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

__all__ = ["kept_views"]


def kept_views(
    names: Sequence[str], target: str, within: int | None, keep: int | None, rng: np.random.Generator
) -> list[int]:
    """Return the places of the views to keep, in capture order, the target's always among them.

    names: of all views in capture order; within: how many frames before and after the target stay; keep: how many views
    stay of those, drawn at random, the target counted. A smaller `keep` keeps a part of what a greater one does.
    """
    at = names.index(target)
    first, last = (0, len(names) - 1) if within is None else (at - within, at + within)
    others = [place for place in range(max(0, first), min(len(names), last + 1)) if place != at]
    if keep is not None:
        others = [others[n] for n in rng.permutation(len(others))[: keep - 1]]
    return sorted([at, *others])
