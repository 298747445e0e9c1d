"""Pinhole geometry: pixels to rays, points and back (SUCRe, eq. 6 and 7).

Pixel centres are at +0.5. A rigid transform is (4, 4), ``cam_from_world`` maps world points to the camera's frame.
"""

from __future__ import annotations

import numpy as np

from sucre_bench.scene import Array, Camera

__all__ = ["distance_map", "pixel_rays", "project", "relative_pose"]


def pixel_rays(camera: Camera) -> Array:
    """Return K^-1 (u + .5, v + .5, 1) of every pixel: (H, W, 3) float32, third component 1."""
    u = np.arange(camera.width) + 0.5
    v = np.arange(camera.height) + 0.5
    grid = np.stack([*np.meshgrid(u, v), np.ones((camera.height, camera.width))], axis=-1)
    return np.asarray(grid @ np.linalg.inv(camera.K).T, dtype=np.float32)


def distance_map(camera: Camera, depth: Array) -> Array:
    """Return the Euclidean distance (H, W) float32 of planar depth (H, W), both in metres; 0 stays 0."""
    return np.asarray(np.linalg.norm(pixel_rays(camera), axis=-1) * depth, dtype=np.float32)


def relative_pose(to_cam_from_world: Array, from_cam_from_world: Array) -> Array:
    """Return the (4, 4) transform from one camera's frame to another's."""
    return np.asarray(to_cam_from_world @ np.linalg.inv(from_cam_from_world))


def project(camera: Camera, points: Array) -> tuple[Array, Array]:
    """Project points (..., 3) of the camera's frame: pixel coordinates (..., 2) and depth (...,).

    Points at or behind the camera's plane (Z <= 0) get NaN coordinates.
    """
    z = points[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        xy = np.where((z > 0)[..., None], points[..., :2] / z[..., None], np.nan)
    return xy @ np.asarray(camera.K[:2, :2].T, dtype=points.dtype) + np.asarray(camera.K[:2, 2], dtype=points.dtype), z
