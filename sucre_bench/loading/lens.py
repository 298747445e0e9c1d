"""Distorted cameras, and the pinhole images made of theirs.

Distortion is OpenCV's: "perspective" with k1 k2 p1 p2 k3 k4 k5 k6 (Brown's model, rational), "fisheye" with k1 k2 k3 k4
(Kannala & Brandt 2006). COLMAP's SIMPLE_RADIAL, RADIAL, OPENCV and FULL_OPENCV are special cases of the first, its
fisheye models of the second. The pinhole camera keeps the principal point and the size; its focal lengths are those at
which no pixel looks past the photograph, so that nothing black comes in at the borders.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sucre_bench.scene import Array, Camera

__all__ = ["Lens"]


@dataclass(frozen=True, eq=False)
class Lens:
    """A camera as it photographs.

    camera: K and size of the distorted image, pixel centres at +0.5; coefficients: of the model's distortion, in
    OpenCV's order, trailing zeros left out.
    """

    camera: Camera
    model: Literal["perspective", "fisheye"]
    coefficients: tuple[float, ...]

    @property
    def identity(self) -> tuple[object, ...]:
        """All that tells this lens from another, for hashes."""
        return (self.camera.K.tolist(), self.camera.width, self.camera.height, self.model, self.coefficients)

    @functools.cached_property
    def pinhole(self) -> Camera:
        """The camera of the undistorted image, of the same size."""
        K, width, height = self.camera.K, self.camera.width, self.camera.height
        x, y = np.linspace(0, width, 33), np.linspace(0, height, 33)
        edge = np.concatenate(
            [np.stack([x, np.full(33, v)], -1) for v in (0.0, height)]
            + [np.stack([np.full(33, u), y], -1) for u in (0.0, width)]
        )
        rays = self._rays(edge)  # (132, 2), at unit depth
        left, right, top, bottom = -K[0, 2], width - K[0, 2], -K[1, 2], height - K[1, 2]
        sides = np.split(rays, 4)  # top, bottom, left, right
        focal_y = max(top / sides[0][:, 1].max(), bottom / sides[1][:, 1].min())
        focal_x = max(left / sides[2][:, 0].max(), right / sides[3][:, 0].min())
        pinhole = K.copy()
        pinhole[0, 0], pinhole[1, 1], pinhole[0, 1] = focal_x, focal_y, 0
        return Camera(pinhole, width, height)

    def undistorted(self, image: Array, size: tuple[int, int]) -> Array:
        """Return an image (H, W[, C]) of the distorted camera, at any scale, as the pinhole sees it, at `size`."""
        import cv2

        height, width = image.shape[:2]
        scale = np.diag([width / self.camera.width, height / self.camera.height, 1.0])
        K = _opencv(scale @ self.camera.K)
        make = cv2.initUndistortRectifyMap if self.model == "perspective" else cv2.fisheye.initUndistortRectifyMap
        x, y = make(K, self._padded, np.eye(3), _opencv(scale @ self.pinhole.K), (width, height), cv2.CV_32FC1)
        straight = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        if (width, height) != size:
            straight = cv2.resize(straight, size, interpolation=cv2.INTER_AREA)
        return np.asarray(straight, dtype=np.float32)

    @property
    def _padded(self) -> Array:
        length = 8 if self.model == "perspective" else 4
        return np.array([*self.coefficients, *[0.0] * (length - len(self.coefficients))])

    def _rays(self, pixels: Array) -> Array:
        """The rays (P, 2) at unit depth through pixels (P, 2) of the distorted image, found by iteration."""
        import cv2

        K, points = _opencv(self.camera.K), pixels[:, None] - 0.5
        if self.model == "fisheye":
            return np.asarray(cv2.fisheye.undistortPoints(points, K, self._padded)[:, 0], dtype=np.float64)
        until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-9)
        return np.asarray(cv2.undistortPoints(points, K, self._padded, criteria=until)[:, 0], dtype=np.float64)


def _opencv(K: Array) -> Array:
    """An intrinsic matrix for pixel centres at whole numbers, as OpenCV has them."""
    moved = K.copy()
    moved[:2, 2] -= 0.5
    return moved
