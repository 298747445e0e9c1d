"""Photographs with their lens and pose, and the views made of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.camera import Camera, scaled_camera
from sucre_bench.errors import InputError
from sucre_bench.imaging.chart_patches import scaled_chart
from sucre_bench.imaging.image_files import check_pixels, image_size, read_rgb, same_shape
from sucre_bench.loading.depth_maps import read_depth
from sucre_bench.loading.lens import Lens
from sucre_bench.loading.view_files import Files
from sucre_bench.scene import Chart, Encoding, Plane, View


@dataclass(frozen=True, eq=False)
class Photograph:
    """An image file with lens, pose, depth map, reference and charts.

    lens: at the size its program states, None if unknown; cam_from_world: (4, 4) float64, metres, None if unknown;
    depth: its depth map, which read_depth turns into planar metres; depth_lens: the camera of the depth map, with the
    same optical axis, None if that is the undistorted camera; reference: the image without water, and charts, with
    corners in pixels: both of the stored image; charts_file: for messages; size: (width, height) of the stored image,
    None if its header is not read yet; read_image: see `Files`; faults: known faults, by plane.
    """

    name: str
    image: Path
    lens: Lens | None = None
    cam_from_world: Array | None = None
    depth: Path | None = None
    read_depth: Callable[[Path], Array] = read_depth
    depth_lens: Lens | None = None
    reference: Path | None = None
    charts: Sequence[Chart] = ()
    charts_file: Path | None = None
    size: tuple[int, int] | None = None
    read_image: Callable[[Path, tuple[int, int] | None], Array] = read_rgb
    faults: Mapping[Plane, str] = field(default_factory=dict)


def straight_lens(camera: Camera) -> Lens:
    """Return the lens of a camera that does not distort."""
    return Lens(camera, "perspective", ())


def view_of(photograph: Photograph, image_scale: float = 1.0, encoding: Encoding = "gamma") -> View:
    """Return the view of a photograph, undistorted when it is decoded. Reads the image's header.

    A wrong image size becomes a fault of the view. Raises InputError if no pinhole image can be made with the lens, or
    if a chart lies where its distortion cannot be undone.
    """
    lens, image, faults = photograph.lens, photograph.image, dict(photograph.faults)
    distorts = lens is not None and (bool(lens.coefficients) or lens.model == "fisheye")
    if lens is not None and distorts and lens.fault:
        raise InputError(f"{lens.fault} (coefficients {lens.coefficients})", image, "undistort the images before")
    straight = None if lens is None else lens.pinhole if distorts else lens.camera
    undistorted = None if straight is None else (straight.width, straight.height)
    # If the header cannot be read, decoding gives the reason.
    size = photograph.size or image_size(image) or undistorted or (1, 1)
    if fault := _fault_of_size(image, size, undistorted):
        faults.setdefault("rgb", fault)
        size = undistorted or (1, 1)  # what else is read of the view must not take on a forged size
    width, height = (max(1, round(side * image_scale)) for side in size)
    camera = None if straight is None else scaled_camera(straight, size, image_scale)
    bent = lens if distorts else None
    read, depth_lens = photograph.read_depth, photograph.depth_lens if photograph.depth is not None else None
    if depth_lens is not None and camera is not None:
        read = _Resampled(read, depth_lens, camera)
    files = Files(
        image,
        (width, height),
        photograph.depth,
        photograph.reference,
        read_depth=read,
        lens=bent,
        depth_lens=depth_lens,
        read_image=photograph.read_image,
        faults=faults,
    )
    place = f"{photograph.charts_file or image}: {photograph.name}"
    charts = tuple(_seen(chart, place, size, bent, (width, height)) for chart in photograph.charts)
    return View(photograph.name, files, camera, photograph.cam_from_world, charts, encoding)


def _fault_of_size(image: Path, size: tuple[int, int], camera: tuple[int, int] | None) -> str:
    """Why an image of a size (width, height) cannot be that of a camera of another; empty if it can."""
    if camera is not None and not same_shape(size, camera):
        fault = f"is {size[0]}x{size[1]}, its camera {camera[0]}x{camera[1]}"
        return f"{image}: {fault}; use the images that its camera was found for, uncropped"
    try:
        check_pixels(image, size)
    except InputError as fault_of_pixels:
        return str(fault_of_pixels)
    return ""


def _seen(chart: Chart, place: str, size: tuple[int, int], lens: Lens | None, target: tuple[int, int]) -> Chart:
    """Transform a chart from the stored image, of `size` (width, height), to the view, of size `target`."""
    if lens is None:
        return scaled_chart(chart, size, target)
    undistorted = lens.camera.width, lens.camera.height
    corners = lens.straightened(scaled_chart(chart, size, undistorted).corners)
    if not np.isfinite(corners).all():
        fault = "a corner lies where the lens cannot be undone"
        raise InputError(f"{place}, {chart.name}: {fault}; leave this chart out")
    return scaled_chart(Chart(chart.name, chart.kind, corners), undistorted, target)


@dataclass(frozen=True, eq=False)
class _Resampled:
    """Reads a depth map of one lens as that of another camera with the same pose."""

    read: Callable[[Path], Array]
    lens: Lens
    camera: Camera

    def __call__(self, path: Path) -> Array:
        metres = self.read(path)
        height, width = metres.shape
        of, to = self.lens.camera, self.camera
        if not same_shape((width, height), (of.width, of.height)):
            fault = f"is {width}x{height}, a size that cannot match its camera's {of.width}x{of.height}"
            raise InputError(fault, path, "make it again of this camera")
        # Nearest: no depth lies between a diver and the seabed behind.
        return self.lens.resampled(metres, to, nearest=True)


def is_rigid(transform: Array) -> bool:
    """Whether (4, 4) is a rotation and a translation, within the few digits that some programs write."""
    R = transform[:3, :3]
    return bool(
        np.isfinite(transform).all()
        and np.allclose(transform[3], (0, 0, 0, 1), atol=1e-6)
        and np.allclose(R @ R.T, np.eye(3), atol=1e-3)
        and np.linalg.det(R) > 0
    )
