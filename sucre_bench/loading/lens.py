"""Distorted cameras, and pinhole images made from their images.

Distortion is OpenCV's: "perspective" with k1 k2 p1 p2 k3 k4 k5 k6 (Brown's model, rational), "fisheye" with k1 k2 k3 k4
(Kannala & Brandt 2006). COLMAP's SIMPLE_RADIAL, RADIAL, OPENCV and FULL_OPENCV are special cases of the first, its
fisheye models of the second. The pinhole camera has the same principal point and size. Its focal lengths are such
that no pixel looks past the photograph: there are no black borders.

Photogrammetry tools fit Brown's model with more terms than OpenCV has, see `BrownLens`. Kalibr writes a camera as a
camchain (YAML) or a report (TXT), see `read_kalibr`.
"""

import functools
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sucre_bench.arrays import Array, Size
from sucre_bench.camera import Camera, intrinsics, scaled_camera
from sucre_bench.errors import InputError
from sucre_bench.machine.files import reading, regular
from sucre_bench.machine.text_formats import read_yaml

Model = Literal["perspective", "fisheye"]

# The least ratio of the pinhole's focal length to the photograph's. A quarter is a fisheye of 160 degrees; it shows the
# middle of the photograph at a quarter of its resolution.
_STRETCH = 4.0
_NEAR_PX = 0.5
# Pixels a block: their coordinates fit the processor's cache and take little memory.
_AT_A_TIME = 200_000


@dataclass(frozen=True, eq=False)
class Lens:
    """A distorted camera."""

    camera: Camera
    """K and size of the distorted image, pixel centres at +0.5."""

    model: Model = "perspective"

    coefficients: tuple[float, ...] = ()
    """Of the model's distortion, in OpenCV's order, trailing zeros left out; none for a camera without distortion."""

    @property
    def identity(self) -> tuple[object, ...]:
        """What identifies this lens, for hashes."""
        return (self.camera.K.tolist(), *self.camera.size, self.model, self.coefficients)

    @property
    def pinhole(self) -> Camera:
        """The camera of the undistorted image, of the same size. Raises InputError if there is a `fault`."""
        if isinstance(self._pinhole, str):
            raise InputError(
                f"a lens of distortion {self.coefficients}: {self.fault}; undistort the images before"
            )
        return self._pinhole

    @property
    def fault(self) -> str:
        """Why there is no pinhole image of this lens; empty if there is one."""
        return self._pinhole if isinstance(self._pinhole, str) else ""

    @functools.cached_property
    def _pinhole(self) -> Camera | str:
        K, width, height = self.camera.K, self.camera.width, self.camera.height
        u, v = (
            a.ravel()
            for a in np.meshgrid(np.linspace(0, width, 33), np.linspace(0, height, 33))
        )
        sides = np.stack([u == 0, u == width, v == 0, v == height])
        edge = sides.any(axis=0)
        x, y = np.full((2, u.size), np.nan)
        x[edge], y[edge] = self.rays(np.stack([u[edge], v[edge]], -1)).T
        # NaN where there is no ray, often in corners
        away = np.where(sides, [-x, x, -y, y], np.nan)
        # How near each side of the photograph comes to the axis: the pinhole may not look beyond.
        nearest = np.fmin.reduce(away, axis=1, initial=np.inf)
        with np.errstate(all="ignore"):
            focals = np.array([K[0, 2], width - K[0, 2], K[1, 2], height - K[1, 2]]) / nearest
            focal_x, focal_y = focals[:2].max(), focals[2:].max()
            stretch = np.array([focal_x / K[0, 0], focal_y / K[1, 1]])
        undone = "its distortion cannot be undone up to the borders"
        if not (np.isfinite(stretch) & (stretch > 0)).all():
            return undone
        if not ((stretch > 1 / _STRETCH) & (stretch < _STRETCH)).all():
            return "its angle of view is too wide for a pinhole image"
        pinhole = K.copy()
        pinhole[0, 0] = focal_x
        pinhole[1, 1] = focal_y
        pinhole[0, 1] = 0
        at = self._pixels((u - pinhole[0, 2]) / focal_x, (v - pinhole[1, 2]) / focal_y).reshape(
            33, 33, 2
        )
        within = (at >= -_NEAR_PX) & (at <= np.array([width, height]) + _NEAR_PX)
        right_of, below = np.diff(at, axis=1)[:-1], np.diff(at, axis=0)[:, :-1]
        # the same place is seen twice
        folded = right_of[..., 0] * below[..., 1] <= right_of[..., 1] * below[..., 0]
        return undone if folded.any() or not within.all() else Camera(pinhole, width, height)

    def undistorted(self, image: Array, size: Size) -> Array:
        """Return an image (H, W[, C]) of the distorted camera, at any scale, as a pinhole image of `size`."""
        import cv2

        own_size = (image.shape[1], image.shape[0])
        straight = self.resampled(image, scaled_camera(self.pinhole, own_size))
        if own_size != size:
            straight = np.asarray(cv2.resize(straight, size, interpolation=cv2.INTER_AREA))
        return np.asarray(straight, dtype=np.float32)

    def resampled(self, image: Array, to: Camera, nearest: bool = False) -> Array:
        """Return an image (H, W[, C]) of the distorted camera, at any scale, as the image of a pinhole at its place.

        nearest: copy the nearest pixel, and 0 beyond the image; else interpolate, and extend the border.
        """
        import cv2

        how = (
            (cv2.INTER_NEAREST, cv2.BORDER_CONSTANT)
            if nearest
            else (cv2.INTER_LINEAR, cv2.BORDER_REPLICATE)
        )
        size = (image.shape[1], image.shape[0])
        straight = np.empty((to.height, to.width, *image.shape[2:]), dtype=image.dtype)
        rows = max(1, _AT_A_TIME // to.width)
        for top in range(0, to.height, rows):
            K = to.K.copy()
            K[1, 2] -= top
            x, y = self._sources(size, Camera(K, to.width, min(rows, to.height - top)))
            straight[top : top + rows] = cv2.remap(
                image, x, y, how[0], borderMode=how[1], borderValue=0
            )
        return straight

    def straightened(self, pixels: Array) -> Array:
        """Return the places (P, 2) in the pinhole image of pixels (P, 2) of the distorted image; NaN if outside."""
        K = self.pinhole.K
        return np.asarray(self.rays(pixels) * (K[0, 0], K[1, 1]) + K[:2, 2])

    def rays(self, pixels: Array) -> Array:
        """Return the rays (P, 2) at unit depth through pixels (P, 2) of the distorted image, NaN where there is none.

        By Newton's method, started at the distorted place, from where it does not overshoot: a barrel's ray lies
        beyond it, a cushion's short of it.
        """
        # (2, P)
        wanted = np.linalg.solve(self.camera.K, np.vstack([pixels.T, np.ones(len(pixels))]))[:2]
        at = wanted
        h = 1e-6
        moves = [np.array(move)[:, None] for move in ((0, 0), (h, 0), (0, h))]
        with np.errstate(all="ignore"):
            for _ in range(25):
                here, right, below = (
                    np.stack(self.bent(*self._ray(at + move))) for move in moves
                )
                ex, ey = wanted - here
                (ax, ay), (bx, by) = (right - here) / h, (below - here) / h
                turn = ax * by - bx * ay
                step = np.stack([by * ex - bx * ey, ax * ey - ay * ex]) / turn
                at = at + step
                if not (np.abs(step) > 1e-12).any():
                    break
            rays = self._ray(at)
            missed = np.linalg.norm(self._pixels(*rays) - pixels, axis=-1)
            # Further out some polynomials turn back and map other rays to the same place: no lens does that.
            found = (missed < _NEAR_PX) & (turn > 0) & ((at * wanted).sum(axis=0) >= 0)
        return np.where(found[:, None], rays.T, np.nan)

    def bent(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return rays x, y at unit depth, arrays of one shape, after distortion, at unit depth."""
        import cv2

        rays = np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 1, 3).astype(np.float64)
        if self.model == "fisheye":
            at = cv2.fisheye.distortPoints(rays[..., :2].copy(), np.eye(3), self._padded)
        else:
            at, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), np.eye(3), self._padded)
        bent = np.asarray(at, dtype=np.float64).reshape(*x.shape, 2)
        return bent[..., 0], bent[..., 1]

    def _sources(self, size: Size, to: Camera) -> tuple[Array, Array]:
        """The places of a pinhole's pixels in an image of `size` (width, height) of this lens at the same place.

        Returns x and y, (H, W) float32 of the pinhole's size, for cv2.remap: pixel centres at whole numbers.
        """
        import cv2

        K = scaled_camera(self.camera, size).K
        make = (
            cv2.initUndistortRectifyMap
            if self.model == "perspective"
            else cv2.fisheye.initUndistortRectifyMap
        )
        maps = make(_centred(K), self._padded, np.eye(3), _centred(to.K), to.size, cv2.CV_32FC1)
        return np.asarray(maps[0], dtype=np.float32), np.asarray(maps[1], dtype=np.float32)

    @property
    def _padded(self) -> Array:
        length = 8 if self.model == "perspective" else 4
        return np.array([*self.coefficients, *[0.0] * (length - len(self.coefficients))])

    def _pixels(self, x: Array, y: Array) -> Array:
        """The places (P, 2) in the distorted image of rays x, y (P,) at unit depth."""
        x, y = self.bent(x, y)
        K = self.camera.K
        return np.stack([K[0, 0] * x + K[0, 1] * y + K[0, 2], K[1, 1] * y + K[1, 2]], -1)

    def _ray(self, at: Array) -> Array:
        """The rays (2, P) of the solution of `rays`: itself, or for a fisheye the ray at that angle from the axis."""
        if self.model == "perspective":
            return at
        angle = np.maximum(np.linalg.norm(at, axis=0), 1e-9)
        return np.asarray(at * (np.tan(np.minimum(angle, 1.57)) / angle))


def _centred(K: Array) -> Array:
    """An intrinsic matrix for pixel centres at whole numbers, as OpenCV has them."""
    moved = K.copy()
    moved[:2, 2] -= 0.5
    return moved


def lens_of(camera: Camera, model: Model, k: tuple[float, ...], p: tuple[float, ...]) -> Lens:
    """Return the lens of a camera, at its size, with k1 to k4 and p1 to p4 of the formulas above, the last left out."""
    k, p = (*k, *[0.0] * (4 - len(k))), (*p, *[0.0] * (4 - len(p)))
    if camera.K[0, 1] == 0 and model == "fisheye" and not any(p):
        return Lens(camera, model, k)
    if camera.K[0, 1] == 0 and model == "perspective" and not any((k[3], p[2], p[3])):
        known = (k[0], k[1], p[0], p[1], k[2])
        return Lens(camera, model, known if any(known) else ())
    return BrownLens(camera, model, (*k, *p))


@dataclass(frozen=True, eq=False)
class BrownLens(Lens):
    """A camera as it photographs; coefficients: k1 k2 k3 k4 p1 p2 p3 p4 of the formulas above."""

    @property
    def identity(self) -> tuple[object, ...]:
        """What identifies this lens, for hashes."""
        return ("brown", *super().identity)

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

    def _sources(self, size: Size, to: Camera) -> tuple[Array, Array]:
        # floats, which leave float32 as it is
        (fx, skew, cx), (_, fy, cy) = scaled_camera(self.camera, size).K[:2].tolist()
        u, v = (
            ((np.arange(side) + 0.5 - to.K[i, 2]) / to.K[i, i]).astype(np.float32)
            for i, side in enumerate(to.size)
        )
        x, y = self.bent(*np.meshgrid(u, v))
        return fx * x + skew * y + (cx - 0.5), fy * y + (cy - 0.5)


_MODELS: dict[str, Model] = {
    "radtan": "perspective",
    "none": "perspective",
    "equidistant": "fisheye",
}
_REPORT = {
    "camera_model": r"Camera model:\s*(\S+)",
    "focal": r"Focal length:\s*\[(.*?)\]",
    "centre": r"Principal point:\s*\[(.*?)\]",
    "distortion_model": r"Distortion model:\s*(\S+)",
    "distortion_coeffs": r"Distortion coefficients:\s*\[(.*?)\]",
}


def read_kalibr(path: Path, size: Size) -> Lens:
    """Return the lens of the first camera that Kalibr calibrated, from its camchain (YAML) or its report (TXT).

        cam0:                                       cam0
          camera_model: pinhole                     -----
          intrinsics: [fx, fy, cx, cy]                Camera model: pinhole
          distortion_model: equidistant               Focal length: [fx, fy]
          distortion_coeffs: [k1, k2, k3, k4]         Principal point: [cx, cy]
          resolution: [width, height]                 Distortion model: radtan
                                                      Distortion coefficients: [k1, k2, p1, p2]

    "radtan" is Brown's distortion with OpenCV's k1 k2 p1 p2, "equidistant" is OpenCV's fisheye. Kalibr's pixel centres
    are at whole numbers: half a pixel is added to its principal point. The report does not state the image's size.
    Source: https://github.com/ethz-asl/kalibr/wiki/yaml-formats

    size: (width, height) of the images in pixels, for a file without it. Raises InputError if the file cannot be read
    or holds no pinhole camera with one of the distortions above.
    """
    with reading(path, "give a camchain, or a report on camera and IMU, as Kalibr writes them"):
        text = regular(path).read_text(encoding="utf-8")
        stored = _report(text) if path.suffix.lower() == ".txt" else read_yaml(text)
        stored = stored.get("cam0", stored)
        focal_x, focal_y, x, y = (float(value) for value in stored["intrinsics"])
        coefficients = [float(value) for value in stored.get("distortion_coeffs") or ()]
        width, height = (int(side) for side in stored.get("resolution", size))
        kind = (stored.get("camera_model", "pinhole"), stored.get("distortion_model", "none"))
        if kind[0] != "pinhole" or kind[1] not in _MODELS:
            raise ValueError(f"{kind[0]} with {kind[1]} distortion is not known here")
        if not (
            np.isfinite([x, y, *coefficients]).all()
            and min(focal_x, focal_y, width, height) > 0
        ):
            raise ValueError(f"focal length {focal_x:g}, {focal_y:g} for {width}x{height}")
    while coefficients and coefficients[-1] == 0:
        coefficients.pop()
    K = intrinsics(focal_x, focal_y, x + 0.5, y + 0.5)
    return Lens(Camera(K, width, height), _MODELS[kind[1]], tuple(coefficients))


def _report(text: str) -> dict[str, Any]:
    """Return the report's camera in the camchain's form."""
    found = {
        name: match[1]
        for name, pattern in _REPORT.items()
        if (match := re.search(pattern, text))
    }
    numbers = {
        name: found[name].replace(",", " ").split()
        for name in ("focal", "centre", "distortion_coeffs")
    }
    return {**found, **numbers, "intrinsics": numbers["focal"] + numbers["centre"]}
