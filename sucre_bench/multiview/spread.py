"""Whether views can measure the water: from how unlike distances they see the same places.

Water is measured by what changes between a near and a far look at one place. Views from one height over flat ground
see each place from one distance; then any attenuation explains them, whatever the depth maps.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import evenly
from sucre_bench.errors import InputError
from sucre_bench.multiview.overlaps import AGREES, seen_from, some_points
from sucre_bench.scene import View

_VIEWS = 12  # evenly chosen, and as many beside them
_POINTS = 1000  # of each

_FEW = 0.05  # of all places: too few to see the water by

# Distances less unlike than this do not tell the water, see docs/sucre.md, "Which dives measure the water".
_ALIKE = 1.12


@dataclass(frozen=True)
class Spread:
    """How unlike the distances are from which views see the same places."""

    ratio: float
    """The farthest distance of a place over its nearest: the median of places that several views see, 1 without
    such."""

    shared: float
    """The share of places that several views see."""

    # 5 and 95 % of all distances.
    nearest: float
    farthest: float

    def sentence(self, unit: str = "m") -> str:
        """Say whether distances are unlike enough to measure the water by, and what to use."""
        apart = f"a factor of {self.ratio:.2f}, all from {self.nearest:.3g} to {self.farthest:.3g} {unit}".rstrip()
        if self.shared < _FEW:
            return "No two views show the same places: SUCRe cannot measure the water. Use dive_gray_world or seathru."
        if self.ratio < _ALIKE:
            fault = f"The views show each place from like distances ({apart}): the water cannot be measured."
            return f"{fault} Use dive_gray_world, or photographs from several distances."
        return f"The views show each place from distances unlike enough to measure the water ({apart})."


def usable(views: Sequence[View]) -> list[View]:
    """Return up to 12 views, evenly chosen, and the next of each, that have camera, pose and readable depth."""
    chosen = sorted(
        {k for n in evenly(len(views), _VIEWS) for k in (n, n + 1) if k < len(views)}
    )
    found = []
    for view in (views[k] for k in chosen):
        with suppress(InputError):  # the run says what is wrong with it
            if view.camera is not None and view.cam_from_world is not None and view.has_depth:
                found.append(view)
    return found


def spread_of(views: Sequence[View]) -> Spread | None:
    """Return the spread of distances of views with poses and depth; None if fewer than two can be read.

    Looks at those that `usable` takes.
    """
    views = usable(views)
    if len(views) < 2:
        return None
    nearest, farthest = [], []
    for view in views:
        *_, points = some_points(view, _POINTS)
        near = far = np.linalg.norm(points, axis=-1)
        for other in views:
            if other is view:
                continue
            there, _, z, d = seen_from(other, view, points)
            distance = np.linalg.norm(there, axis=-1)
            is_seen = (d > 0) & (np.abs(d - z) <= AGREES * z)
            near = np.where(is_seen, np.minimum(near, distance), near)
            far = np.where(is_seen, np.maximum(far, distance), far)
        nearest.append(near)
        farthest.append(far)
    near, far = np.concatenate(nearest), np.concatenate(farthest)
    if not len(near):
        return None
    is_shared = far > near
    ratio = float(np.median(far[is_shared] / near[is_shared])) if is_shared.any() else 1.0
    low, high = np.quantile(np.concatenate([near, far]), (0.05, 0.95))
    return Spread(ratio, float(is_shared.mean()), float(low), float(high))
