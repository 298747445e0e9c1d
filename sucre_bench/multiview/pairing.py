"""Which pixel of another view shows what a pixel of the target shows (SUCRe, sec. 3, eq. 4 and 5).

A target pixel's centre with its depth is projected into the other view and lands (floor) on a pixel there; that
pixel's centre with its own depth is projected back. The two are paired when it lands (floor) on the pixel it came
from. So each target pixel has at most one match in a view, occluded points have none, and one gather per target
pixel decides it: no map of the other view's own projections is needed.

The arithmetic is float32 in the camera's frame (relative poses are formed in float64): it differs from float64
where a point projects within about 1e-3 px of a pixel's border.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.errors import InputError
from sucre_bench.multiview.geometry import landing_pixels, relative_pose, unproject
from sucre_bench.scene import Array, Camera, Mask, View

__all__ = ["Matches", "Surface", "lift", "match", "own_matches"]

Indices = npt.NDArray[np.integer[Any]]

# A tile's points lie in the hull of eight corners, so a view that sees no hull sees no pixel. Smaller tiles fit the
# scene closer and cost more corners: 64 px makes 510 tiles of a 1920x1080 image, 0.1 ms to test against a view.
_TILE_PX = 64

# Points worked at a time: temporaries stay in the cache, and products with 3x3 matrices below the size from which
# BLAS starts threads, whose waiting on a busy machine costs more than the work.
_CHUNK_PX = 1 << 14


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """What a target view shows: its pixels with depth as points, grouped in square tiles of the image.

    camera, cam_from_world: the target's; pixels: (P,) int64 flat indices, tile after tile;
    points: (3, P) float32 metres in the camera's frame, of the pixels' centres;
    tile_sizes: (T,) pixels in each tile that has any;
    tile_corners: (3, 8, T) float64, the corners of the frustum piece that holds a tile's points.
    """

    camera: Camera
    cam_from_world: Array
    pixels: Indices
    points: Array
    tile_sizes: Indices
    tile_corners: Array


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """The pairs of a target and one other view.

    pixels: (M,) int64 flat indices into the target, each at most once; others: (M,) int64 flat indices into the
    other view; distance: (M,) float32 metres from the other view's camera to the centre of its pixel.
    """

    pixels: Indices
    others: Indices
    distance: Array


def lift(view: View) -> Surface:
    """Return a target's pixels with depth as points.

    Raises InputError when the view has no camera, no pose, no depth map, or one of another size than the camera's.
    """
    if view.camera is None or view.cam_from_world is None:
        raise InputError(f"{view.name}: the view has no camera pose; pairing needs one, choose a registered view")
    depth = _depth(view, view.camera)
    v, u = np.nonzero(depth)
    tile_of = v // _TILE_PX * (depth.shape[1] // _TILE_PX + 1) + u // _TILE_PX
    by_tile = np.argsort(tile_of.astype(np.int32), kind="stable")
    v, u, tile_of = v[by_tile], u[by_tile], tile_of[by_tile]
    d = depth[v, u]
    tiles, first, sizes = np.unique(tile_of, return_index=True, return_counts=True)
    points = unproject(view.camera, u + 0.5, v + 0.5, d)
    corners = _tile_corners(view.camera, u[first], v[first], d, first) if len(tiles) else np.empty((3, 8, 0))
    return Surface(view.camera, view.cam_from_world, v * depth.shape[1] + u, points, sizes, corners)


def _depth(view: View, camera: Camera) -> Array:
    depth = view.depth
    if depth.shape != (camera.height, camera.width):
        sizes = f"{depth.shape[1]}x{depth.shape[0]}, the camera's image {camera.width}x{camera.height}"
        raise InputError(f"{view.name}: the depth map is {sizes}; resample it to the image's size")
    return depth


def _tile_corners(camera: Camera, u: Indices, v: Indices, depth: Array, first: Indices) -> Array:
    """The tiles that hold pixels (u, v), as frustum pieces between their least and largest depth: (3, 8, T)."""
    left, top = u // _TILE_PX * _TILE_PX, v // _TILE_PX * _TILE_PX
    right, bottom = left + _TILE_PX, top + _TILE_PX
    near, far = np.minimum.reduceat(depth, first), np.maximum.reduceat(depth, first)
    x = np.stack([left, right, left, right] * 2)  # (8, T)
    y = np.stack([top, top, bottom, bottom] * 2)
    return unproject(camera, x, y, np.stack([near] * 4 + [far] * 4).astype(np.float64))


def own_matches(surface: Surface) -> Matches:
    """Return the target's pairs with itself: every pixel with depth, by definition and not by rounding."""
    return Matches(surface.pixels, surface.pixels, _norm(surface.points))


def _norm(points: Array) -> Array:
    return np.asarray(np.sqrt((points * points).sum(axis=0)), dtype=np.float32)


def match(surface: Surface, view: View) -> Matches | None:
    """Return the pairs of a target and another view; None when that view lacks a pose or depth, or cannot see it.

    The view's depth map is read only when part of the target is in its field of view, its image never.
    Raises InputError when its depth map is of another size than its camera's image.
    """
    if view.camera is None or view.cam_from_world is None:
        return None
    to_view = relative_pose(view.cam_from_world, surface.cam_from_world)
    seen = _may_be_seen(view.camera, to_view, surface.tile_corners)
    if not seen.any() or not view.has_depth:
        return None
    depth = _depth(view, view.camera).ravel()
    to_target = relative_pose(surface.cam_from_world, view.cam_from_world)
    candidates = np.flatnonzero(np.repeat(seen, surface.tile_sizes))
    chunks = np.split(candidates, range(_CHUNK_PX, len(candidates), _CHUNK_PX))
    parts = [_mutual(surface, chunk, view.camera, depth, to_view, to_target) for chunk in chunks]
    return Matches(*(np.concatenate(fields) for fields in zip(*parts, strict=True)))


def _may_be_seen(camera: Camera, pose: Array, corners: Array) -> Mask:
    """(T,) bool, False only where no point of the hull of eight corners (3, 8, T) can project into the image.

    A field of view is convex, the intersection of five half-spaces; a hull whose corners all lie outside the same
    one lies outside. The image is taken one pixel larger on each side, far more than float32 rounding.
    """
    x, y, z = camera.K @ pose[:3]  # of (x w, y w, w): each (4,)
    half_spaces = np.stack([z, x + z, (camera.width + 1) * z - x, y + z, (camera.height + 1) * z - y])  # (5, 4)
    values = np.tensordot(half_spaces[:, :3], corners, axes=1) + half_spaces[:, 3, None, None]  # (5, 8, T)
    return np.asarray(~(values < 0).all(axis=1).any(axis=0))


def _mutual(
    surface: Surface, here: Indices, camera: Camera, depth: Array, to_view: Array, to_target: Array
) -> tuple[Indices, Indices, Array]:
    """The fields of Matches for some points of the surface; `here`, their indices, shrinks with every test."""
    u, v = landing_pixels(camera, to_view, surface.points[:, here])
    inside = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)  # NaN, behind the camera, is not
    here, u, v = here[inside], u[inside], v[inside]
    others = v.astype(np.int64) * camera.width + u.astype(np.int64)
    has_depth = depth[others] > 0
    here, u, v, others = here[has_depth], u[has_depth], v[has_depth], others[has_depth]

    points = unproject(camera, u + np.float32(0.5), v + np.float32(0.5), depth[others])
    u, v = landing_pixels(surface.camera, to_target, points)
    pixels = surface.pixels[here]
    mutual = (u == pixels % surface.camera.width) & (v == pixels // surface.camera.width)
    return pixels[mutual], others[mutual], _norm(points[:, mutual])
