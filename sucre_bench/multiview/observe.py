"""Everything that the views of a scene show of a target's pixels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sucre_bench.errors import InputError, SolveError
from sucre_bench.multiview.observations import Observations, Seen, arrange, compact
from sucre_bench.multiview.pairing import Surface, lift, match, own_matches
from sucre_bench.progress import say, track
from sucre_bench.scene import View

__all__ = ["observe"]

# A view is left out when it shows no more than this share of the target's pixels (the authors' program).
MIN_SHARE = 1e-6


def observe(target: View, views: Sequence[View], *, with_view: bool = False) -> Observations:
    """Pair the target with the views (itself among them) and return all observations of its pixels with depth.

    Views without a pose or depth are left out, as are those that show 1e-6 of the target's pixels or less, and those
    with a file that cannot be read: one damaged image of a dive does not cost the others theirs.
    Raises SolveError when the target has no pixel with depth; InputError when it has no depth map or pose.
    """
    surface = lift(target)
    if not len(surface.pixels):
        raise SolveError(f"{target.name}: no pixel has depth; check its depth map, 0 means unknown")
    height, width = target.depth.shape
    seen: list[Seen] = []
    if all(view.name != target.name for view in views):
        views = [target, *views]
    unreadable: list[str] = []
    for view in track(views, "pairing"):
        try:
            if (one := _see(surface, target, view, MIN_SHARE * height * width)) is not None:
                seen.append(one)
        except InputError as fault:
            if view.name == target.name:
                raise
            unreadable.append(str(fault))
            say(f"{target.name}: does without {view.name}: {fault}")
    return replace(arrange((height, width), seen, with_view=with_view), unreadable=tuple(unreadable))


def _see(surface: Surface, target: View, view: View, least: float) -> Seen | None:
    """What a view shows of the target; None when that is no more than `least` pixels."""
    matches = own_matches(surface) if view.name == target.name else match(surface, view)
    if matches is None or len(matches.pixels) <= least:
        return None
    colour = view.rgb.reshape(-1, 3)[matches.others]  # (M, 3)
    return Seen(view.name, matches.pixels.astype(np.int32), matches.distance, compact(colour))
