"""Finds the points that two views of a scene both show, in small patches, and the pairs of views that share any.

Single pixels of two photographs differ where the surface has texture. Depth and poses are off by a part of a pixel, and
the nearer camera resolves more. So colours are compared as means over patches of 8 x 8 pixels of the view that resolves
the points less. Points are matched from that view by the mutual rule (mutual.py): each pixel has its own partner.
Where the other view is nearer, one of its pixels would be a poor sample of a pixel's area: nine are taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from cachetools import LRUCache

from sucre_bench.arrays import Array, Indices, evenly
from sucre_bench.multiview.pairing import Surface, lift, match, visible_pixels
from sucre_bench.restored_pair import CommonPoints
from sucre_bench.scene import View

# The side of a patch, px. A mean over 64 pixels has an eighth of the noise; wrong pixels at its border weigh little.
_SIDE = 8

# Patches of a view that are tried, and those of a pair that are kept: their mean has an error of 5 % of the spread.
_TRIED = 4000
_KEPT = 400

# A patch counts if at least this share of its pixels is matched.
_FILLED = 0.75
# A pair counts if it has so many patches.
_FEWEST = 5

# A view is paired with at most so many others, evenly spread over those that it overlaps.
_OTHERS = 16

# From this ratio of footprints on, nine pixels of the nearer view are taken for one.
_MUCH_NEARER = 1.5
# The depths of these nine agree to this share.
_SAME_SURFACE = 0.03

# Surfaces held in memory, 4 MB each.
_HELD = 64

# So many of a view's partners, those with the largest overlap, are its neighbours.
_NEIGHBOURS = 2


def surface_of(view: View) -> Surface | None:
    """Return a view's pixels with depth as points; None if it has no camera, pose or depth."""
    if (
        view.camera is None
        or view.cam_from_world is None
        or not view.has_depth
        or not view.valid.any()
    ):
        return None
    return lift(view)


@dataclass(frozen=True)
class Overlap:
    """Two views that may see the same points."""

    # Places of the views in the scene.
    first: int
    second: int

    are_neighbours: bool
    """Whether one of them overlaps more with the other than with all but one of the views."""


class SharedPoints:
    """Which of a scene's views overlap, and the points that two of them share."""

    def __init__(self, views: Sequence[View]) -> None:
        """Read nothing yet."""
        self._views = views
        self._surfaces: LRUCache[int, Surface | None] = LRUCache(_HELD)

    def overlaps(self) -> list[Overlap]:
        """Return the pairs of views that may see the same points, from depth and poses, in order.

        Each view chooses at most 16 partners. Raises InputError if a depth map's size is not its camera's.
        """
        shares = np.zeros((len(self._views), len(self._views)), dtype=np.float32)
        for i in range(len(self._views)):
            surface = self._surface(i)
            if surface is not None and len(surface.pixels):
                shares[i] = visible_pixels(surface, self._views) / len(surface.pixels)
        # what a view sees of the other counts little if the other sees only a corner of it
        shares *= shares.T
        np.fill_diagonal(shares, 0)
        chosen: dict[tuple[int, int], bool] = {}
        for i, shared in enumerate(shares):
            seen = np.flatnonzero(shared)
            nearest = set(seen[np.argsort(-shared[seen], kind="stable")][:_NEIGHBOURS].tolist())
            for j in nearest | {int(seen[k]) for k in evenly(len(seen), _OTHERS)}:
                key = (min(i, j), max(i, j))
                chosen[key] = chosen.get(key, False) or j in nearest
        return [Overlap(*key, is_near) for key, is_near in sorted(chosen.items())]

    def of(self, overlap: Overlap) -> CommonPoints | None:
        """Return the points that two views share, in at most 400 patches; None if they share fewer than five patches.

        Raises InputError if a depth map's size is not its camera's.
        """
        first, second = self._surface(overlap.first), self._surface(overlap.second)
        if first is None or second is None:
            return None
        if _footprint(second) > _footprint(first):
            # patches are of the view with the larger pixels on the ground
            points = _patches(second, self._views[overlap.first])
            return points and points.turned()
        return _patches(first, self._views[overlap.second])

    def _surface(self, place: int) -> Surface | None:
        """The surface of a view's patches, at most 4,000 of them, evenly spread; None as in `surface_of`."""
        if place not in self._surfaces:
            surface = surface_of(self._views[place])
            if surface is not None:
                patch = _patch_of(surface.pixels, surface.camera.width)
                surface = surface.only(surface.pixels[np.isin(patch, _filled(patch, _TRIED))])
            self._surfaces[place] = surface
        return self._surfaces[place]


def _patch_of(pixels: Indices, width: int) -> Indices:
    """The number of the patch that each pixel lies in."""
    row, column = np.divmod(pixels, width)
    return np.asarray(row // _SIDE * -(-width // _SIDE) + column // _SIDE)


def _filled(patch: Indices, most: int) -> Indices:
    """The numbers of at most so many patches with enough pixels, evenly spread. patch: the number of each pixel."""
    filled = np.flatnonzero(np.bincount(patch) >= _FILLED * _SIDE**2)
    return filled[evenly(len(filled), most)]


def _footprint(surface: Surface) -> float:
    """The side of a pixel on the ground, metres."""
    return (
        float(np.median(surface.points[2])) / float(surface.camera.K[0, 0])
        if len(surface.pixels)
        else 0.0
    )


def _patches(surface: Surface, other: View) -> CommonPoints | None:
    """The patches of a surface that another view shows."""
    matches = match(surface, other)
    if matches is None or not len(matches.pixels):
        return None
    patch = _patch_of(matches.pixels, surface.camera.width)
    chosen = _filled(patch, _KEPT)
    if len(chosen) < _FEWEST:
        return None
    kept = np.flatnonzero(np.isin(patch, chosen))
    number = np.searchsorted(chosen, patch[kept]).astype(np.int32)
    pixels, others, distance = (
        matches.pixels[kept],
        matches.others[kept],
        matches.distance[kept],
    )
    at = np.zeros(surface.camera.height * surface.camera.width, dtype=np.int64)
    at[surface.pixels] = np.arange(len(surface.pixels))
    points = surface.points[:, at[pixels]].astype(np.float64)
    distance_here = np.sqrt((points**2).sum(axis=0))
    samples, owner = _samples(others, points[2] / surface.camera.K[0, 0], other)
    sums = [np.bincount(number, of) for of in (distance_here, distance)]
    return CommonPoints(
        pixels, samples, number, number[owner], np.stack(sums) / np.bincount(number)
    )


def _samples(others: Indices, footprint: Array, view: View) -> tuple[Indices, Indices]:
    """Pixels of a view over the area of each of M pixels of another, and the pixel that each belongs to.

    others: (M,) the pixel of the view at its middle; footprint: (M,) its side on the ground, metres.
    """
    assert view.camera is not None
    height, width = view.depth.shape
    row, column = np.divmod(others.astype(np.int64), width)
    depth = view.depth[row, column]
    side = footprint * view.camera.K[0, 0] / depth  # px of the view
    if np.median(side) < _MUCH_NEARER:
        return others, np.arange(len(others))
    found, owners = [], []
    for v, u in np.ndindex(3, 3):
        y, x = (
            np.floor(at + 0.5 + (step - 1) / 3 * side).astype(np.int64)
            for at, step in ((row, v), (column, u))
        )
        inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
        near = np.zeros(len(others))
        near[inside] = view.depth[y[inside], x[inside]]
        owner = np.flatnonzero(np.abs(near - depth) <= _SAME_SURFACE * depth)
        found.append((y * width + x)[owner])
        owners.append(owner)
    return np.concatenate(found).astype(np.int32), np.concatenate(owners)
