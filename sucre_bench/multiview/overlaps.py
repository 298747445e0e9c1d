"""How much views of a scene overlap, and whether their depth agrees there; views are compared at a reduced size.

Two views overlap if a point of one projects to a pixel of the other at depth Z, and that view's own depth d agrees:
|d - Z| <= 5 % of Z. In consistent data the median of |d - Z| / Z is a few per mille.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array, Indices, evenly
from sucre_bench.camera import depth_at, moved, project, relative_pose, scaled_camera, unproject
from sucre_bench.machine.progress import track
from sucre_bench.multiview.pairing import lift, visible_pixels
from sucre_bench.scene import Arrays, View

LONG_SIDE = 480  # pixels of a reduced view
# relative difference of depths that agree
AGREES = 0.05
_PARTNER = 0.05  # share of a view's points that another one must see to overlap
MOST_TARGETS = 40  # views that are compared with all others, evenly chosen
MOST_POINTS = 8000  # of a view


@dataclass(frozen=True)
class Overlap:
    """The overlap of one view with the others."""

    view: str

    seen: float
    """Share of its points that at least one other view sees."""

    partners: int
    """Number of views that see 5 % of its points or more."""

    disagreement: float | None
    """Median of |d - Z| / Z of its points that project into others, None if there are none."""


def reduced(view: View) -> View:
    """Return a view with camera, pose and depth at reduced size, black. InputError if its depth is unreadable."""
    import cv2

    camera, pose = view.placed
    shrink = min(1.0, LONG_SIDE / max(camera.size))
    camera = scaled_camera(camera, camera.size, shrink)
    depth = cv2.resize(view.depth, camera.size, interpolation=cv2.INTER_NEAREST_EXACT)
    black = np.zeros((*depth.shape, 3), np.float32)
    return View(view.name, Arrays(black, np.asarray(depth)), camera, pose)


def overlaps(views: Sequence[View]) -> list[Overlap]:
    """Return the overlap of up to 40 views, evenly chosen, with all others; views need pose and depth."""
    between = []
    for view in track([views[k] for k in evenly(len(views), MOST_TARGETS)], "overlaps"):
        *_, points = some_points(view, MOST_POINTS)
        seen = np.zeros(len(points), bool)
        partners = 0
        off = []
        for other, most in zip(views, visible_pixels(lift(view), views), strict=True):
            if other is view or not most:
                continue
            _, _, z, d = seen_from(other, view, points)
            rel = np.abs(np.divide(d - z, z, out=np.full(len(z), np.nan), where=d > 0))
            seen |= rel <= AGREES
            partners += bool((rel <= AGREES).mean() >= _PARTNER)
            if np.isfinite(rel).mean() >= _PARTNER:
                off.append(rel[np.isfinite(rel)])
        disagreement = float(np.median(np.concatenate(off))) if off else None
        between.append(
            Overlap(view.name, float(seen.mean()) if len(seen) else 0.0, partners, disagreement)
        )
    return between


def some_points(view: View, most: int) -> tuple[Indices, Indices, Array]:
    """Return row and column (P,) of about so many pixels with depth, and their points (P, 3) in the camera's frame."""
    v, u = np.nonzero(view.depth > 0)
    step = max(1, len(u) // most)
    v, u = v[::step], u[::step]
    return (
        v,
        u,
        unproject(view.placed[0], u + 0.5, v + 0.5, view.depth[v, u].astype(np.float64)).T,
    )


def seen_from(other: View, view: View, points: Array) -> tuple[Array, Array, Array, Array]:
    """Project points (P, 3) of a view's camera into another view.

    Return the points in its camera's frame, their pixels (P, 2), their depth Z there, and that view's own depth d (P,),
    0 where it is unknown or the point is outside.
    """
    there = moved(points, relative_pose(other.placed[1], view.placed[1]))
    at, z = project(other.placed[0], there)
    return there, at, z, depth_at(other.depth, at)
