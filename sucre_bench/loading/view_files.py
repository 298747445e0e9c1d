"""Views whose pixels are in files: photographs with lens and pose, decoded on demand, and their data_id.

A run decodes a file once: its processes, methods and targets map the pixels from a store, see `with_shared_pixels`.
"""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from sucre_bench.arrays import AnyArray, Array, Picture, Size
from sucre_bench.camera import Camera, scaled_camera
from sucre_bench.errors import InputError, check_number
from sucre_bench.imaging.chart_patches import scaled_chart
from sucre_bench.imaging.colour_profiles import Profile, profile_of, read_srgb
from sucre_bench.imaging.image_files import (
    check_pixels,
    image_size,
    is_jpeg,
    read_rgb,
    resized,
    same_shape,
)
from sucre_bench.imaging.orientation import lying_as
from sucre_bench.imaging.reference_images import say_if_black
from sucre_bench.loading.depth_maps import fitted, read_depth
from sucre_bench.loading.find_folders import Found
from sucre_bench.loading.lens import Lens
from sucre_bench.machine import cache
from sucre_bench.machine.files import regular
from sucre_bench.machine.progress import track
from sucre_bench.machine.provenance import engine_hash
from sucre_bench.machine.text_formats import natural_order
from sucre_bench.scene import Chart, Encoding, Plane, Scene, View


@dataclass(frozen=True, eq=False)
class Files:
    """A view's pixels, in files that are decoded on demand.

    A known fault, also one in place of a file, is raised when the plane is used, so that other views continue.
    """

    image: Path

    size: Size
    """Width and height of every plane, pixels."""

    depth: Found = None
    reference: Found = None

    read_depth: Callable[[Path], Array] = read_depth
    """Returns planar metres (H, W), 0 = unknown, at any scale of the image's size."""

    lens: Lens | None = None
    """Of the stored image and reference, which are then undistorted. Depth maps are of the undistorted image."""

    depth_lens: Lens | None = None
    """The lens of the depth map, if it is not the view's camera."""

    read_image: Callable[[Path, Size | None], Array] = read_rgb
    """Reads the image, like `read_rgb`."""

    fault: str = ""
    """Of the image."""

    @property
    def is_jpeg(self) -> bool:
        """Whether the image is a JPEG file, by its first bytes."""
        return is_jpeg(self.image)

    @property
    def profile(self) -> Profile | None:
        """The colour profile of the image, whose values methods see as they are stored; None if that is sRGB."""
        return profile_of(self.image)

    def load(self, plane: Plane) -> Array | None:
        """Decode a plane, a reference in sRGB. Raises InputError for an unreadable file or a known fault."""
        path = (self.fault or self.image) if plane == "rgb" else getattr(self, plane)
        if isinstance(path, str):
            raise InputError(path)
        if path is None:
            return None
        if plane == "depth":
            return fitted(self.read_depth(path), self.size, path)
        read = self.read_image if plane == "rgb" else self._read_reference
        return (
            read(path, self.size)
            if self.lens is None
            else self.lens.undistorted(read(path, None), self.size)
        )

    def _read_reference(self, path: Path, size: Size | None) -> Array:
        def photograph() -> Array:
            return self.read_image(self.image, None)

        found = lying_as(read_srgb(path)[0], path, photograph, self.image)
        say_if_black(path, found, photograph)
        return resized(found, size, path)


def source_files(view: View) -> Iterator[Path]:
    """Yield the files that a view's pixels are read from; none if they are made."""
    pixels: object = view.pixels
    while not isinstance(pixels, Files):
        pixels = getattr(pixels, "files", None) or getattr(pixels, "source", None)
        if pixels is None:
            return
    yield from (
        path
        for path in (pixels.image, pixels.depth, pixels.reference)
        if isinstance(path, Path)
    )


def scaled_pose(cam_from_world: Array, metres_per_unit: float) -> Array:
    """Return a pose (4, 4) in metres, from one in another unit of length."""
    metric = cam_from_world.copy()
    metric[:3, 3] *= metres_per_unit
    return metric


@dataclass(frozen=True, eq=False)
class Photograph:
    """An image file with lens, pose, depth map, reference and charts.

    A str in place of a file says why it cannot be used.
    """

    name: str
    image: Path

    lens: Lens | None = None
    """At the size its program states; None if unknown."""

    cam_from_world: Array | None = None
    """Shape (4, 4), float64, metres; None if unknown."""

    depth: Found = None
    """Its depth map."""

    read_depth: Callable[[Path], Array] = read_depth
    """Turns the depth map into planar metres."""

    depth_lens: Lens | None = None
    """The camera of the depth map, with the same optical axis; None if that is the undistorted camera."""

    reference: Found = None
    """The image without water, distorted like the stored image."""

    charts: Sequence[Chart] = ()
    """With corners in pixels of the stored image."""

    charts_file: Path | None = None
    """For messages."""

    size: Size | None = None
    """Width and height of the stored image; None if its header is not read yet."""

    read_image: Callable[[Path, Size | None], Array] = read_rgb
    """See `Files`."""

    fault: str = ""
    """Of the image."""


def view_of(
    photograph: Photograph, image_scale: float = 1.0, encoding: Encoding = "gamma"
) -> View:
    """Return the view of a photograph, undistorted when it is decoded. Reads the image's header.

    A wrong image size becomes a fault of the view. Raises InputError if no pinhole image can be made with the lens, if
    a chart lies where its distortion cannot be undone, or if the scaled image is too small to have its shape.
    """
    lens, image, fault = photograph.lens, photograph.image, photograph.fault
    distorts = lens is not None and (bool(lens.coefficients) or lens.model == "fisheye")
    if lens is not None and distorts and lens.fault:
        raise InputError(
            f"{lens.fault} (coefficients {lens.coefficients})",
            image,
            "undistort the images before",
        )
    straight = None
    if lens is not None:
        straight = lens.pinhole if distorts else lens.camera
    undistorted = None if straight is None else straight.size
    # If the header cannot be read, decoding gives the reason.
    size = photograph.size or image_size(image) or undistorted or (1, 1)
    try:
        if undistorted is not None and not same_shape(size, undistorted):
            sizes = f"is {size[0]}x{size[1]}, its camera {undistorted[0]}x{undistorted[1]}"
            raise InputError(
                sizes, image, "use the images that its camera was found for, uncropped"
            )
        check_pixels(image, size)
    except InputError as wrong_size:
        fault = fault or str(wrong_size)
        # what else is read of the view must not take on a forged size
        size = undistorted or (
            1,
            1,
        )
    width, height = (max(1, round(side * image_scale)) for side in size)
    if not same_shape(size, (width, height)):
        raise InputError(
            f"makes {width}x{height} of {photograph.name}, {size[0]}x{size[1]}",
            f"image_scale={image_scale:g}",
            "give a larger one",
        )
    camera = None if straight is None else scaled_camera(straight, size, image_scale)
    bent = lens if distorts else None
    read = photograph.read_depth
    depth_lens = photograph.depth_lens if photograph.depth is not None else None
    if depth_lens is not None and camera is not None:
        read = partial(_resampled, read, depth_lens, camera)
    planes = (image, (width, height), photograph.depth, photograph.reference)
    files = Files(*planes, read, bent, depth_lens, photograph.read_image, fault)
    place = f"{photograph.charts_file or image}: {photograph.name}"
    charts = tuple(
        _seen(chart, place, size, bent, (width, height)) for chart in photograph.charts
    )
    return View(photograph.name, files, camera, photograph.cam_from_world, charts, encoding)


def scene_of(
    name: str,
    photographs: Iterable[Photograph],
    image_scale: float = 1.0,
    encoding: Encoding = "gamma",
    *more: object,
) -> Scene:
    """Return the scene of photographs in natural order, which has what any of them has.

    Reads headers and samples of their files.

    more: what decides the views besides their files, for the data id. Raises InputError as `view_of` does.
    """
    photographs = sorted(photographs, key=lambda one: natural_order(one.name))
    views = [
        view_of(photograph, image_scale, encoding)
        for photograph in track(photographs, "image sizes")
    ]
    has = {
        "poses": any(photograph.cam_from_world is not None for photograph in photographs),
        "depth": any(photograph.depth for photograph in photographs),
        "reference": any(photograph.reference for photograph in photographs),
        "charts": any(photograph.charts for photograph in photographs),
    }
    return Scene(
        name,
        views,
        frozenset(what for what, there in has.items() if there),
        data_id=data_id_of(views, *more),
    )


def _seen(chart: Chart, place: str, size: Size, lens: Lens | None, target: Size) -> Chart:
    """Transform a chart from the stored image, of `size` (width, height), to the view, of size `target`."""
    if lens is None:
        return scaled_chart(chart, size, target)
    undistorted = lens.camera.size
    corners = lens.straightened(scaled_chart(chart, size, undistorted).corners)
    if not np.isfinite(corners).all():
        fault = "a corner lies where the lens cannot be undone"
        raise InputError(f"{place}, {chart.name}: {fault}; leave this chart out")
    return scaled_chart(Chart(chart.name, chart.kind, corners), undistorted, target)


def _resampled(read: Callable[[Path], Array], lens: Lens, camera: Camera, path: Path) -> Array:
    """Read a depth map of one lens as that of another camera with the same pose."""
    metres = read(path)
    height, width = metres.shape
    if not same_shape((width, height), lens.camera.size):
        fault = f"is {width}x{height}, a size that cannot match its camera's {lens.camera.width}x{lens.camera.height}"
        raise InputError(fault, path, "make it again of this camera")
    # Nearest: no depth lies between a diver and the seabed behind.
    return lens.resampled(metres, camera, nearest=True)


_WHOLE = 1 << 20  # bytes; larger files are hashed in blocks


_BLOCKS = 16
_BLOCK = 4096


def data_id_of(views: Sequence[View], *more: object) -> str:
    """Return a hash of cameras, poses, options and files of views, and of `more`.

    Files are hashed by `fingerprint`, with its limits. Charts have a hash of their own (`engine.score.charts_id`), so
    that a chart that is marked later makes no restoration out of date.
    """
    digest = hashlib.blake2b(repr(more).encode() if more else b"", digest_size=6)
    for view in track(views, "hashing"):
        assert isinstance(view.pixels, Files)
        K = None if view.camera is None else view.camera.K.tolist()
        pose = None if view.cam_from_world is None else view.cam_from_world.tolist()
        lenses: list[object] = [] if view.pixels.lens is None else [view.pixels.lens.identity]
        lenses += (
            []
            if view.pixels.depth_lens is None
            else [("depth", view.pixels.depth_lens.identity)]
        )
        digest.update(
            repr((view.name, view.encoding, (K, view.pixels.size, pose, *lenses))).encode()
        )
        for path in (view.pixels.image, view.pixels.depth, view.pixels.reference):
            digest.update(fingerprint(path) if isinstance(path, Path) else b"none")
    return digest.hexdigest()


def fingerprint(path: Path) -> bytes:
    """Return a hash of a file's size and content; its date does not count.

    Files up to 1 MiB are hashed whole. Larger files are hashed in 16 blocks of 4 KiB at equal distances, first and last
    included. Whole files would be 90 GB of a large dataset at every start. A change between the blocks that keeps the
    size goes unnoticed. PNG and JPEG files count by their first and last block. Both are compressed, and PNG ends on a
    checksum, so a change shows in the size or at the end.
    """
    try:
        with regular(path).open("rb") as file:
            size = file.seek(0, 2)
            compressed = path.suffix.lower() in (".png", ".jpg", ".jpeg")
            blocks = 2 if compressed else _BLOCKS
            if size <= (blocks * _BLOCK if compressed else _WHOLE):
                file.seek(0)
                return hashlib.blake2b(b"%d" % size + file.read()).digest()
            digest = hashlib.blake2b(b"%d" % size)
            for i in range(blocks):
                file.seek((size - _BLOCK) * i // (blocks - 1))
                digest.update(file.read(_BLOCK))
            return digest.digest()
    except (OSError, InputError):
        return b"unreadable"


@dataclass(frozen=True, kw_only=True)
class ImageScaleOption:
    """The option of datasets that can shrink their images. Raises InputError if an option is out of its range."""

    ranges: ClassVar[Mapping[str, str]] = {}
    """Of other options; one whose default is none may be none."""

    image_scale: float = 1.0
    """Shrink images by this factor, above 0 up to 1; with them depth maps, references, cameras and chart corners."""

    def __post_init__(self: Any) -> None:
        for option, interval in {"image_scale": "(0, 1]", **self.ranges}.items():
            if (value := getattr(self, option)) is not None or getattr(
                type(self), option
            ) is not None:
                check_number(f"{type(self).__plugin__.place}.{option}", value, interval)


# -- pixels that the processes of a run share ---------------------------------------------------------------

_ROWS = 128  # of an image, compared at once


@dataclass(frozen=True, eq=False)
class SharedPixels:
    """Decoded files, which a store holds while one is in use (`machine.cache.storing`).

    Images whose values are the levels of 8 bits are stored as these, a quarter of the size. What `load` returns is
    equal to the last bit.
    """

    files: Files
    """What is decoded."""

    key: str
    """Of the view in the store, the same for the same data and code."""

    @property
    def is_jpeg(self) -> bool:
        """Whether the image is a JPEG file."""
        return self.files.is_jpeg

    @property
    def profile(self) -> Profile | None:
        """The colour profile of the image."""
        return self.files.profile

    def load(self, plane: Plane) -> Array | None:
        """Return a plane; of depth maps, the file's mapped values. Raises InputError for a file that is unreadable."""
        values = self._stored(plane)
        if values is None:
            return self.files.load(plane)
        return np.divide(values, np.float32(255)) if values.dtype == np.uint8 else values

    def levels(self) -> Picture | None:
        """Return the image (H, W, 3) as mapped 8-bit levels; None without a store, or if it has other values."""
        values = self._stored("rgb")
        return values if values is not None and values.dtype == np.uint8 else None

    def _stored(self, plane: Plane) -> AnyArray | None:
        store = cache.current()
        if store is None or (plane != "rgb" and getattr(self.files, plane) is None):
            return None

        def decoded() -> AnyArray:
            import cv2

            values = self.files.load(plane)
            assert values is not None
            if plane == "depth":
                return values
            levels = cv2.convertScaleAbs(values, alpha=255)
            bands = (slice(top, top + _ROWS) for top in range(0, len(values), _ROWS))
            is_exact = all(
                np.array_equal(levels[band] / np.float32(255), values[band]) for band in bands
            )
            return levels if is_exact else values

        return store.get(f"{self.key} {plane}", decoded)


def with_shared_pixels(scene: Scene) -> Scene:
    """Return a scene whose files are decoded once a run. One without a data_id cannot be known again, and stays."""
    if not scene.data_id:
        return scene
    key = f"{engine_hash()} {scene.data_id}"
    views = list(scene.views)
    for i, view in enumerate(views):
        if isinstance(view.pixels, Files):
            views[i] = replace(view, pixels=SharedPixels(view.pixels, f"{key} {view.name}"))
    return replace(scene, views=views)
