"""A relief of a seabed: heights of the sparse points over their main plane, as triangles for ray casting.

It is for dives too long for a plane sweep and for seabeds without overhangs: a place has one height.
"""

import importlib
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array
from sucre_bench.camera import pixel_rays
from sucre_bench.errors import InputError
from sucre_bench.programs.prepare.registered_photos import Shot

_LEAST_TRACK = 3
_NEAREST = 8
_ODD = 6.0  # in median absolute deviations of a height from its neighbours
_LONG = 6.0  # longest edge, in median edges


class Relief:
    """A triangle mesh that rays can be cast at. points: (P, 3), triangles: (T, 3) indices."""

    def __init__(self, points: Array, triangles: npt.NDArray[np.int64]) -> None:
        try:
            o3d: Any = importlib.import_module("open3d")
        except (ImportError, OSError) as fault:
            remedy = "give --surface dense, or install what sucre-bench doctor says"
            raise InputError(f"open3d: does not load ({fault}); {remedy}") from fault
        self._middle = points.mean(axis=0)  # rays are cast in float32
        self._tensor = o3d.core.Tensor
        self._scene = o3d.t.geometry.RaycastingScene()
        near = self._tensor((points - self._middle).astype(np.float32))
        self._scene.add_triangles(near, self._tensor(triangles.astype(np.uint32)))

    def depth(self, shot: Shot) -> Array:
        """Return planar depth (H, W) float32, 0 off the surface."""
        # Along rays of unit depth, the distance to the hit is the planar depth.
        rays = pixel_rays(shot.camera) @ shot.cam_from_world[:3, :3].astype(np.float32)
        origin = np.broadcast_to((shot.centre - self._middle).astype(np.float32), rays.shape)
        hit = self._scene.cast_rays(self._tensor(np.concatenate([origin, rays], axis=-1)))["t_hit"].numpy()
        return np.where(np.isfinite(hit), hit, 0).astype(np.float32)


def relief_of(shots: Sequence[Shot]) -> Relief:
    """Return the surface through points seen in three photos or more. Raises InputError if there are too few."""
    from scipy.spatial import Delaunay, cKDTree

    ids = np.concatenate([shot.point_ids for shot in shots])
    _, first = np.unique(ids, return_index=True)
    points = np.concatenate([shot.points for shot in shots])[first]
    points = points[np.concatenate([shot.tracks for shot in shots])[first] >= _LEAST_TRACK]
    if len(points) < 20:
        fault = f"three photos or more agree on only {len(points)} points, too few for a surface"
        raise InputError(f"photos: {fault}; give --surface dense, or take photos that overlap more")
    in_plane = (points - np.median(points, axis=0)) @ _axes(points).T  # (P, 3), the last is height
    _, near = cKDTree(in_plane[:, :2]).query(in_plane[:, :2], k=min(_NEAREST, len(points)))
    off = np.abs(in_plane[:, 2] - np.median(in_plane[near, 2], axis=1))
    fine = off <= _ODD * max(float(np.median(off)), 1e-12)
    points, in_plane = points[fine], in_plane[fine]
    triangles = Delaunay(in_plane[:, :2]).simplices
    edges = np.linalg.norm(in_plane[triangles][:, :, :2] - np.roll(in_plane[triangles][:, :, :2], 1, axis=1), axis=2)
    return Relief(points, triangles[edges.max(axis=1) <= _LONG * np.median(edges)])


def _axes(points: Array) -> Array:
    """(3, 3) rows: two directions along the plane that most points lie near, and its normal."""
    centred = points - np.median(points, axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    for _ in range(10):  # again, without points far off the plane
        height = np.abs(centred @ axes[2])
        axes = np.linalg.svd(centred[height <= 3 * np.median(height) + 1e-12], full_matrices=False)[2]
    return np.asarray(axes)
