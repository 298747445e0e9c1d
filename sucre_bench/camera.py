"""Pinhole geometry: pixels to rays, points and back (SUCRe, eq. 4 and 5).

Pixel coordinates are (x, y) with pixel centres at +0.5. A rigid transform is (4, 4); ``cam_from_world`` maps world
points to the camera's frame. Images of rays have coordinates on the last axis. `unproject` is made for millions of
scattered points and has coordinates on the first axis, (3, ...), because NumPy is several times faster with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arguments import array_of, checked_fields
from sucre_bench.arrays import Array
from sucre_bench.errors import InputError, check_number

_MOST = 1e9  # pixels, of a focal length
_NORMALISED = 2.0  # K of which no value is larger is in units of the image's size, not pixels
_FAR_OFF = 100.0  # image sides, of a principal point from the image's middle


_REMEDY = "pass [[f, 0, cx], [0, f, cy], [0, 0, 1]] in pixels"


def pixel_rays(camera: Camera) -> Array:
    """Return K^-1 (u + .5, v + .5, 1) of every pixel: (H, W, 3) float32, third component 1."""
    rays = np.ones((camera.height, camera.width, 3), dtype=np.float32)
    rays[..., 0], rays[..., 1] = _slopes(camera)
    return rays


def distance_map(camera: Camera, depth: Array) -> Array:
    """Return the Euclidean distance (H, W) float32 of planar depth (H, W), both in metres; 0 stays 0."""
    x, y = (slope.astype(np.float32) for slope in _slopes(camera))
    return np.asarray(np.sqrt(x * x + y * y + np.float32(1)) * depth, dtype=np.float32)


def _slopes(camera: Camera) -> tuple[Array, Array]:
    """Return x / z and y / z of the ray through every pixel, as arrays that broadcast to (H, W)."""
    K_inv = np.linalg.inv(camera.K)
    u = np.arange(camera.width) + 0.5
    v = (np.arange(camera.height) + 0.5)[:, None]
    if not K_inv[0, 1] and not K_inv[1, 0]:  # without skew, columns tell x and rows y
        return K_inv[0, 0] * u + K_inv[0, 2], K_inv[1, 1] * v + K_inv[1, 2]
    return K_inv[0, 0] * u + K_inv[0, 1] * v + K_inv[0, 2], K_inv[1, 0] * u + K_inv[
        1, 1
    ] * v + K_inv[1, 2]


def relative_pose(to_cam_from_world: Array, from_cam_from_world: Array) -> Array:
    """Return the (4, 4) transform from one camera's frame to another's."""
    return np.asarray(to_cam_from_world @ np.linalg.inv(from_cam_from_world))


def moved(points: Array, transform: Array) -> Array:
    """Return points (..., 3) after a rigid transform: of world points and ``cam_from_world``, in the camera's frame."""
    return np.asarray(points @ transform[:3, :3].T + transform[:3, 3])


def project(camera: Camera, points: Array) -> tuple[Array, Array]:
    """Project points (..., 3) of the camera's frame: pixel coordinates (..., 2) and depth (...,).

    Points at or behind the camera's plane (Z <= 0) get NaN coordinates.
    """
    z = points[..., 2]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        xy = np.where((z > 0)[..., None], points[..., :2] / z[..., None], np.nan)
    return xy @ np.asarray(camera.K[:2, :2].T, dtype=points.dtype) + np.asarray(
        camera.K[:2, 2], dtype=points.dtype
    ), z


def depth_at(depth: Array, xy: Array) -> Array:
    """Return the depth (P,) float64 of the pixels at coordinates (P, 2); 0 where it is unknown or outside.

    NaN coordinates, of points behind a camera, are outside.
    """
    height, width = depth.shape
    with np.errstate(invalid="ignore"):
        inside = (xy >= 0).all(axis=1) & (xy[:, 0] < width) & (xy[:, 1] < height)
    column, row = xy[inside].astype(np.int64).T
    found = np.zeros(len(xy))
    found[inside] = depth[row, column]
    return found


def unproject(camera: Camera, x: npt.NDArray[Any], y: npt.NDArray[Any], depth: Array) -> Array:
    """Return the points (3, ...), in the camera's frame, at pixel coordinates and planar depth, in depth's type."""
    K_inv = np.linalg.inv(camera.K).astype(depth.dtype)
    xy1 = np.stack([x, y, np.ones_like(x)]).astype(depth.dtype, copy=False)
    # Not by BLAS: for products as thin as this one, its threads wait longer for each other than they work.
    return np.asarray(np.einsum("ij,j...->i...", K_inv, xy1) * depth)


@dataclass(frozen=True, eq=False)
@checked_fields
class Camera:
    """A pinhole camera without distortion.

    >>> camera = Camera(np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), 640, 480)
    >>> pixel_rays(camera)[240, 320].tolist()  # the pixel right and below the principal point
    [0.0010000000474974513, 0.0010000000474974513, 1.0]
    """

    K: Array
    """(3, 3) float64 intrinsic matrix in pixels, with pixel centres at +0.5."""

    width: int
    """Of the image, in pixels."""

    height: int
    """Of the image, in pixels."""

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "K", array_of("Camera.K", self.K, (3, 3), finite=True, kinds="fiu")
        )
        if np.abs(self.K).max() > _MOST or not np.linalg.det(self.K):
            raise InputError("has no inverse, or values above 1e9", "Camera.K", _REMEDY)
        check_number("Camera.width", self.width, "[1, 1e6]")
        check_number("Camera.height", self.height, "[1, 1e6]")
        (focal_x, focal_y) = np.diag(self.K)[:2]
        centre = self.K[:2, 2]
        faults = {
            "has another last row than 0 0 1": not np.allclose(self.K[2], (0, 0, 1)),
            f"has focal lengths of {focal_x:g} and {focal_y:g}": min(focal_x, focal_y) <= 0,
            "is not in pixels": min(self.size) > 4 * _NORMALISED
            and np.abs(self.K[:2]).max() <= _NORMALISED,
            "has its principal point far off the image": np.abs(centre).max()
            > _FAR_OFF * max(self.size),
        }
        for fault, is_so in faults.items():
            if is_so:
                raise InputError(fault, "Camera.K", _REMEDY)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.width, self.height


def is_rigid(transform: Array, tolerance: float = 1e-3) -> bool:
    """Whether (4, 4) is a rotation and a translation, within the few digits that some programs write.

    Of products and inverses of such transforms, the tolerance must be some times larger.
    """
    R = transform[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        is_near = (
            np.abs(transform[3] - (0, 0, 0, 1)).max() <= 1e-6
            and np.abs(R @ R.T - np.eye(3)).max() <= tolerance
        )
    return bool(is_near and np.linalg.det(R) > 0)  # False with NaN


def pose_of(rotation: Array, translation: Array) -> Array:
    """Return the transform (4, 4) of a rotation (3, 3) and a translation (3,)."""
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = translation
    return pose


def intrinsics(focal_x: float, focal_y: float, x: float, y: float, skew: float = 0) -> Array:
    """Return K (3, 3) of focal lengths and a principal point, pixels."""
    return np.array([[focal_x, skew, x], [0, focal_y, y], [0, 0, 1]], dtype=np.float64)


def centred_camera(focal_px: float, width: int, height: int) -> Camera:
    """Return the camera of square pixels whose axis meets the middle of the image."""
    return Camera(intrinsics(focal_px, focal_px, width / 2, height / 2), width, height)


def scaled_camera(camera: Camera, size: tuple[int, int], image_scale: float = 1.0) -> Camera:
    """Return the camera for images of `size` (width, height) times `image_scale` instead of its own size."""
    width, height = (max(1, round(side * image_scale)) for side in size)
    return Camera(
        np.diag([width / camera.width, height / camera.height, 1.0]) @ camera.K, width, height
    )
