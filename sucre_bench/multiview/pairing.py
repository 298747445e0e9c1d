"""Finds the pixel of another view that shows the same point as a pixel of the target (SUCRe, sec. 3, eq. 4 and 5).

A target pixel has at most one match in a view, and a hidden point has none: see mutual.py.

Poses alone rule out the views that cannot see the target; their files are not read. Relative poses are float64; the
other arithmetic is float32 in the camera's frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sucre_bench.arrays import Array, Indices, Mask
from sucre_bench.camera import Camera, relative_pose, unproject
from sucre_bench.errors import InputError
from sucre_bench.multiview.mutual import mutual
from sucre_bench.scene import View

# A tile's points lie in the hull of eight corners, so a view that sees no hull sees no pixel. Smaller tiles fit the
# scene closer and cost more corners: 64 px makes 510 tiles of a 1920x1080 image, 0.1 ms to test against a view.
_TILE_PX = 64


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A target's pixels with depth as points, grouped in square tiles of the image."""

    # Those of the target.
    camera: Camera
    cam_from_world: Array

    pixels: Indices
    """Flat indices, (P,) int32, tile after tile."""

    points: Array
    """The pixels' centres in the camera's frame, (3, P) float32, metres."""

    tile_starts: Indices
    """Shape (T + 1,), int64. Tile t is elements tile_starts[t] to tile_starts[t + 1]; tiles without points are left
    out."""

    tile_corners: Array
    """The corners of the frustum piece that holds a tile's points, (3, 8, T) float64."""

    corners: Array
    """The corners of the frustum piece that holds all points, (3, 8, 1) float64."""

    def only(self, pixels: Indices) -> Surface:
        """Return the surface with some of its pixels: flat indices into the target."""
        kept = np.isin(self.pixels, pixels)
        before = np.append(0, np.cumsum(kept))
        return replace(
            self,
            pixels=self.pixels[kept],
            points=self.points[:, kept],
            tile_starts=before[self.tile_starts],
        )


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """The pairs of a target and one other view."""

    pixels: Indices
    """Flat indices into the target, (M,) int32, each at most once."""

    others: Indices
    """Flat indices into the other view, (M,) int32."""

    distance: Array
    """Metres from the other view's camera to the centre of its pixel, (M,) float32."""

    at: Array | None = None
    """Pixel coordinates x, y of the target's point in the other view, (M, 2) float32; None for the pixel's centre."""

    def only(self, which: Mask) -> Matches:
        """Return the chosen pairs. which: (M,) bool."""
        fields = (self.pixels, self.others, self.distance, self.at)
        return Matches(*(None if values is None else values[which] for values in fields))  # type: ignore[arg-type]


def lift(view: View, tile_px: int = _TILE_PX) -> Surface:
    """Return a target's pixels with depth as points.

    tile_px: side of the tiles that are tested for being in another view's image as one.
    Raises InputError if the view has no camera, pose or depth map, or if the map's size is not the camera's.
    """
    if view.camera is None or view.cam_from_world is None:
        raise InputError(
            "the view has no camera pose",
            view.name,
            "pairing needs one, choose a registered view",
        )
    depth = _depth(view, view.camera)
    height, width = depth.shape
    index = np.arange(height * width, dtype=np.int32).reshape(height, width)
    corners = [(x, y) for y in range(0, height, tile_px) for x in range(0, width, tile_px)]
    tiles = [
        index[y : y + tile_px, x : x + tile_px][depth[y : y + tile_px, x : x + tile_px] > 0]
        for x, y in corners
    ]
    sizes = np.array([len(tile) for tile in tiles])
    pixels = np.concatenate(tiles)
    d = depth.ravel()[pixels]
    starts = np.append(0, np.cumsum(sizes[sizes > 0]))
    left, top = np.array(corners)[sizes > 0].T
    points = []  # K^-1 (u + .5, v + .5, 1) d of the pixels' centres
    for of_u, of_v, of_one in np.linalg.inv(view.camera.K):
        along_x = (of_u * (np.arange(width) + 0.5) + of_one).astype(np.float32)
        along_y = (of_v * (np.arange(height) + 0.5)).astype(np.float32)
        points.append(((along_x + along_y[:, None]) * depth).ravel()[pixels])
    boxes = np.stack([left, top, left + tile_px, top + tile_px])
    return Surface(
        view.camera,
        view.cam_from_world,
        pixels,
        np.stack(points),
        starts,
        _frustum_pieces(view.camera, boxes, d, starts[:-1]),
        _frustum_pieces(view.camera, np.array([[0], [0], [width], [height]]), d, starts[:1]),
    )


def _depth(view: View, camera: Camera) -> Array:
    depth = view.depth
    if depth.shape != (camera.height, camera.width):
        sizes = f"{depth.shape[1]}x{depth.shape[0]}, the camera's image {camera.width}x{camera.height}"
        raise InputError(
            f"the depth map is {sizes}", view.name, "resample it to the image's size"
        )
    return depth


def _frustum_pieces(camera: Camera, boxes: Indices, depth: Array, first: Indices) -> Array:
    """The corners (3, 8, T) of boxes in the image (left, top, right, bottom), over their range of depth.

    first: (T,) the index into depth at which each box begins.
    """
    if not len(depth):
        return np.empty((3, 8, 0))
    left, top, right, bottom = boxes
    near, far = np.minimum.reduceat(depth, first), np.maximum.reduceat(depth, first)
    x = np.stack([left, right, left, right] * 2)  # (8, T)
    y = np.stack([top, top, bottom, bottom] * 2)
    return unproject(camera, x, y, np.stack([near] * 4 + [far] * 4).astype(np.float64))


def own_matches(surface: Surface) -> Matches:
    """Return the target's pairs with itself: every pixel with depth, without any rounding."""
    distance = np.sqrt((surface.points * surface.points).sum(axis=0)).astype(np.float32)
    return Matches(surface.pixels, surface.pixels, distance)


def visible_pixels(surface: Surface, views: Sequence[View]) -> Indices:
    """Return an upper bound (V,) int64 of the target's pixels that each view sees, from poses alone.

    0: the view has no pose, or looks elsewhere. All views are tested against the whole target at once, then the
    remaining ones tile by tile.
    """
    most = np.zeros(len(views), dtype=np.int64)
    posed = [
        k
        for k, view in enumerate(views)
        if view.camera is not None and view.cam_from_world is not None
    ]
    if posed:
        near = _may_be_seen(
            *_fields_of_view(surface, [views[k] for k in posed]), surface.corners
        ).any(axis=-1)
        for k in np.array(posed)[near]:
            most[k] = np.diff(_visible_ranges(surface, views[k])).sum()
    return most


def _fields_of_view(surface: Surface, views: Sequence[View]) -> tuple[Array, Indices, Array]:
    """Intrinsic matrices (V, 3, 3), image sizes (V, 2) and poses (V, 4, 4), from the target's frame to the cameras'."""
    cameras = [view.camera for view in views if view.camera is not None]
    poses = [view.cam_from_world for view in views if view.cam_from_world is not None]
    sizes = np.array([camera.size for camera in cameras])
    return (
        np.stack([camera.K for camera in cameras]),
        sizes,
        relative_pose(np.stack(poses), surface.cam_from_world),
    )


def _visible_ranges(surface: Surface, view: View) -> Indices:
    """(R, 2) starts and stops of the points in tiles that a view may see."""
    seen = _may_be_seen(*_fields_of_view(surface, [view]), surface.tile_corners)[0]
    return np.stack([surface.tile_starts[:-1], surface.tile_starts[1:]], axis=1)[seen]


def match(surface: Surface, view: View) -> Matches | None:
    """Return the pairs of a target and another view; None if that view has no pose or depth, or cannot see the target.

    The view's depth map is read only if part of the target is in its field of view; its image is not read.
    Raises InputError if the depth map's size is not the camera's.
    """
    if view.camera is None or view.cam_from_world is None:
        return None
    ranges = _visible_ranges(surface, view)
    if not len(ranges) or not view.has_depth:
        return None
    depth = np.ascontiguousarray(_depth(view, view.camera), np.float32)
    tried = (surface.points, surface.pixels, ranges)
    to_view = relative_pose(view.cam_from_world, surface.cam_from_world)
    to_target = relative_pose(surface.cam_from_world, view.cam_from_world)
    return Matches(*mutual(*tried, surface.camera, view.camera, depth, to_view, to_target))


def _may_be_seen(K: Array, size: Indices, pose: Array, corners: Array) -> Mask:
    """(..., T) bool, False only where no point of the hull of eight corners (3, 8, T) can project into the image.

    K: (..., 3, 3); size: (..., 2) width, height; pose: (..., 4, 4), to the camera from the corners' frame.

    A field of view is convex, the intersection of five half-spaces; a hull whose corners all lie outside the same
    one lies outside. The image is taken one pixel larger on each side, far more than float32 rounding.
    """
    x, y, z = np.moveaxis(K @ pose[..., :3, :], -2, 0)  # of (x w, y w, w): each (..., 4)
    width, height = size[..., :1], size[..., 1:]
    # (..., 5, 4)
    half_spaces = np.stack(
        [z, x + z, (width + 1) * z - x, y + z, (height + 1) * z - y], axis=-2
    )
    # (..., 5, 8, T)
    values = (
        np.tensordot(half_spaces[..., :3], corners, axes=1) + half_spaces[..., 3, None, None]
    )
    return np.asarray(~(values < 0).all(axis=-2).any(axis=-2))
