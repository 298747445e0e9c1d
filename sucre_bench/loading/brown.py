"""Brown's lens with all the terms that photogrammetry tools fit, and where a pinhole's pixels lie in a photograph.

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8) + (2 p1 x y + p2 (r^2 + 2 x^2)) (1 + p3 r^2 + p4 r^4)
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8) + (2 p2 x y + p1 (r^2 + 2 y^2)) (1 + p3 r^2 + p4 r^4)

and then K, with a skew if it has one; a fisheye bends x, y to the angle from the axis before. OpenCV has neither k4 nor
p3 and p4, a skew, or p1 and p2 of a fisheye; a lens without these is a plain `Lens`, which is several times faster.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from sucre_bench.loading.lens import Lens
from sucre_bench.scene import Array, Camera

__all__ = ["BrownLens", "lens_of", "source_pixels"]


def lens_of(
    camera: Camera, model: Literal["perspective", "fisheye"], k: tuple[float, ...], p: tuple[float, ...]
) -> Lens:
    """Return the lens of a camera, at its size, with k1 to k4 and p1 to p4 of the formulas above, the last left out."""
    k, p = (*k, *[0.0] * (4 - len(k))), (*p, *[0.0] * (4 - len(p)))
    if camera.K[0, 1] == 0 and model == "fisheye" and not any(p):
        return Lens(camera, model, k)
    if camera.K[0, 1] == 0 and model == "perspective" and not any((k[3], p[2], p[3])):
        known = (k[0], k[1], p[0], p[1], k[2])
        return Lens(camera, model, known if any(known) else ())
    return BrownLens(camera, model, (*k, *p))


def source_pixels(lens: Lens, size: tuple[int, int], to: Camera) -> tuple[Array, Array]:
    """Where the pixels of a pinhole camera lie in an image of `size` (width, height) that a lens made from that place.

    Returns x and y, (H, W) float32 of the pinhole's size, for cv2.remap: pixel centres at whole numbers.
    """
    import cv2

    of = lens.camera
    K = np.diag([size[0] / of.width, size[1] / of.height, 1.0]) @ of.K
    if isinstance(lens, BrownLens):
        u, v = (np.arange(side, dtype=np.float32) + np.float32(0.5) for side in (to.width, to.height))
        x, y = lens.bent(*np.meshgrid((u - to.K[0, 2]) / to.K[0, 0], (v - to.K[1, 2]) / to.K[1, 1]))
        at = K[0, 0] * x + K[0, 1] * y + (K[0, 2] - 0.5), K[1, 1] * y + (K[1, 2] - 0.5)
        return np.asarray(at[0], dtype=np.float32), np.asarray(at[1], dtype=np.float32)
    make = cv2.initUndistortRectifyMap if lens.model == "perspective" else cv2.fisheye.initUndistortRectifyMap
    terms = np.zeros(8 if lens.model == "perspective" else 4)
    terms[: len(lens.coefficients)] = lens.coefficients
    maps = make(_centred(K), terms, np.eye(3), _centred(to.K), (to.width, to.height), cv2.CV_32FC1)
    return np.asarray(maps[0], dtype=np.float32), np.asarray(maps[1], dtype=np.float32)


def _centred(K: Array) -> Array:
    """An intrinsic matrix for pixel centres at whole numbers, as OpenCV has them."""
    moved = K.copy()
    moved[:2, 2] -= 0.5
    return moved


@dataclass(frozen=True, eq=False)
class BrownLens(Lens):
    """A camera as it photographs; coefficients: k1 k2 k3 k4 p1 p2 p3 p4 of the formulas above."""

    @property
    def identity(self) -> tuple[object, ...]:
        """All that tells this lens from another, for hashes."""
        return ("brown", self.camera.K.tolist(), self.camera.width, self.camera.height, self.model, self.coefficients)

    def undistorted(self, image: Array, size: tuple[int, int]) -> Array:
        """Return an image (H, W[, C]) of the distorted camera, at any scale, as the pinhole sees it, at `size`."""
        import cv2

        height, width = image.shape[:2]
        pinhole = self.pinhole
        scale = np.diag([width / pinhole.width, height / pinhole.height, 1.0])
        x, y = source_pixels(self, (width, height), Camera(scale @ pinhole.K, width, height))
        straight = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        if (width, height) != size:
            straight = cv2.resize(straight, size, interpolation=cv2.INTER_AREA)
        return np.asarray(straight, dtype=np.float32)

    def bent(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return x', y' of rays x, y at unit depth, arrays of one shape."""
        k1, k2, k3, k4, p1, p2, p3, p4 = self.coefficients
        if self.model == "fisheye":
            r = np.maximum(np.sqrt(x * x + y * y), 1e-9)
            angle = np.arctan(r) / r
            x, y = x * angle, y * angle
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
        more = 1 + r2 * (p3 + r2 * p4)
        return (
            x * radial + (2 * p1 * x * y + p2 * (r2 + 2 * x * x)) * more,
            y * radial + (2 * p2 * x * y + p1 * (r2 + 2 * y * y)) * more,
        )

    def _rays(self, pixels: Array) -> Array:
        """The rays (P, 2) at unit depth through pixels (P, 2) of the distorted image, by Newton's method."""
        bent = np.linalg.solve(self.camera.K, np.vstack([pixels.T, np.ones(len(pixels))]))[:2]  # (2, P)
        r = np.linalg.norm(bent, axis=0)
        # A fisheye's image is the angle: begin at its tangent, short of looking sideways.
        x, y = bent * (np.tan(np.minimum(r, 1.4)) / np.maximum(r, 1e-9) if self.model == "fisheye" else 1.0)
        h = 1e-6
        for _ in range(30):
            fx, fy = self.bent(x, y)
            (ax, ay), (bx, by) = self.bent(x + h, y), self.bent(x, y + h)
            ex, ey = bent[0] - fx, bent[1] - fy
            j = np.array([[(ax - fx) / h, (bx - fx) / h], [(ay - fy) / h, (by - fy) / h]])  # (2, 2, P)
            determinant = j[0, 0] * j[1, 1] - j[0, 1] * j[1, 0]
            x = x + (j[1, 1] * ex - j[0, 1] * ey) / determinant
            y = y + (j[0, 0] * ey - j[1, 0] * ex) / determinant
        return np.stack([x, y], -1)
