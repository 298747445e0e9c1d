"""Photographs whose lens and place another program found, and the views made of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sucre_bench.errors import InputError
from sucre_bench.images import image_size, same_shape
from sucre_bench.loading.depth import read_depth
from sucre_bench.loading.files import Files, scaled_camera
from sucre_bench.loading.lens import Lens
from sucre_bench.scene import Array, Camera, Encoding, Plane, View

__all__ = ["Photograph", "is_rigid", "view_of"]


@dataclass(frozen=True, eq=False)
class Photograph:
    """An image file, and what is known of it.

    lens: as it photographed, at the size its program says; cam_from_world: (4, 4) float64, metres, None when unknown;
    depth: its depth map, which read_depth turns into planar metres; depth_lens: the camera that the depth map is of, on
    the optical axis of this one; None when that is the undistorted image; faults: what is already known to be wrong, by
    plane.
    """

    name: str
    image: Path
    lens: Lens
    cam_from_world: Array | None
    depth: Path | None = None
    read_depth: Callable[[Path], Array] = read_depth
    depth_lens: Lens | None = None
    faults: Mapping[Plane, str] = field(default_factory=dict)


def view_of(photograph: Photograph, image_scale: float = 1.0, encoding: Encoding = "gamma") -> View:
    """Return the view of a photograph, undistorted on the way where its lens distorts. Reads the image's header.

    What is wrong with the image's size becomes a fault of the view. Raises InputError for a lens that no pinhole
    image can be made of.
    """
    lens, image, faults = photograph.lens, photograph.image, dict(photograph.faults)
    distorts = bool(lens.coefficients) or lens.model == "fisheye"
    if distorts and lens.fault:
        raise InputError(f"{image}: {lens.fault} (coefficients {lens.coefficients}); undistort the images before")
    straight = lens.pinhole if distorts else lens.camera
    size = image_size(image) or (straight.width, straight.height)
    if not same_shape(size, (straight.width, straight.height)):
        fault = f"is {size[0]}x{size[1]}, its camera {straight.width}x{straight.height}"
        faults.setdefault("rgb", f"{image}: {fault}; use the images that the reconstruction was made of")
    camera = scaled_camera(straight, size, image_scale)
    read = photograph.read_depth
    if photograph.depth_lens is not None:
        read = _Resampled(read, photograph.depth_lens, camera)
    files = Files(
        image,
        (camera.width, camera.height),
        photograph.depth,
        read_depth=read,
        lens=lens if distorts else None,
        faults=faults,
    )
    return View(photograph.name, files, camera, photograph.cam_from_world, (), encoding)


@dataclass(frozen=True, eq=False)
class _Resampled:
    """Reads a depth map of one lens as another camera at the same place, looking the same way, has it."""

    read: Callable[[Path], Array]
    lens: Lens
    camera: Camera

    def __call__(self, path: Path) -> Array:
        metres = self.read(path)
        height, width = metres.shape
        of, to = self.lens.camera, self.camera
        if not same_shape((width, height), (of.width, of.height)):
            fault = f"is {width}x{height}, a size that cannot match its camera's {of.width}x{of.height}"
            raise InputError(f"{path}: {fault}; make it again of this camera")
        # Nearest: between a diver and the seabed behind lies nothing.
        return self.lens.resampled(metres, to, nearest=True)


def is_rigid(transform: Array) -> bool:
    """Whether (4, 4) is a rotation and a translation, to the few digits that some programs write."""
    R = transform[:3, :3]
    return bool(
        np.isfinite(transform).all()
        and np.allclose(transform[3], (0, 0, 0, 1), atol=1e-6)
        and np.allclose(R @ R.T, np.eye(3), atol=1e-3)
        and np.linalg.det(R) > 0
    )
