"""Scenes that OpenMVS densified: its depth maps, and the undistorted images that they name.

root/depth0000.dmap ...   depth maps, one an image; their headers hold cameras and poses, so that scene.mvs is not read
root/images/<name>        the images, wherever they are below root

A depth map is little-endian: "DR", or "D2" of the versions that store half floats; flags (uint8, bit 0: has depth), for
D2 the power of two that depths were divided by (int8); image width, height, depth width, height (uint32); least and
greatest depth, for D2 the scale of the confidence (float32); length (uint16) and name of the image; number (uint32) and
ids of the views (uint32); K, R (3x3), C (3) float64 by rows; depths by rows; then normals, confidence and views, not
read here. K is of the image's size, its pixel centres at whole numbers; R, C: x = R (X - C). Depth is planar, 0 where
unknown. Source: https://github.com/cdcseacave/openMVS/wiki/Interface
"""

import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from sucre_bench import Camera, dataset, track
from sucre_bench.arrays import Array
from sucre_bench.camera import is_rigid, pose_of
from sucre_bench.errors import DamagedFileError, InputError
from sucre_bench.imaging.image_files import PICTURE_READERS
from sucre_bench.loading.find_folders import ImageFolder, check_images, existing
from sucre_bench.loading.lens import Lens
from sucre_bench.loading.view_files import ImageScaleOption, Photograph, scaled_pose, scene_of
from sucre_bench.machine.files import reading, regular
from sucre_bench.scene import Encoding, Scene


@dataset(
    requires=PICTURE_READERS,
    cites="Cernea 2020, OpenMVS",
    source="your own scenes: the working folder of OpenMVS's DensifyPointCloud",
    proven="has read no file of OpenMVS yet, only ours in its format",
    has=("poses", "depth"),
    signs=("*.dmap",),
)
@dataclass(frozen=True)
class Openmvs(ImageScaleOption):
    """A scene with depth maps of OpenMVS: one view a depth map, in order of the images' names."""

    ranges: ClassVar = {"metres_per_unit": "(0, inf)"}

    root: Path
    """The folder that holds the depth maps and, in it or below, the images."""
    dmaps: str = "*.dmap"
    """Which depth maps, as a pattern of paths in root; one an image."""
    metres_per_unit: float = 1.0
    """Length in metres of one unit of the reconstruction; leave 1 if it is metric already, or unknown."""
    encoding: Encoding = "gamma"
    """How images are encoded: "gamma" (sRGB-like) or "linear"."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if Path(self.dmaps).is_absolute() or ".." in Path(self.dmaps).parts or not self.dmaps:
            raise InputError(
                f"openmvs.dmaps: '{self.dmaps}' is no pattern of paths in root; give '*.dmap'"
            )

    def scenes(self) -> Iterator[Scene]:
        """Yield the one scene, named like its folder. Reads headers and samples of depth maps and images.

        Raises InputError for what concerns all views: no depth map, one without a readable header, two of one image, no
        image at all. Other faults are raised when the view's pixels are loaded.
        """
        root = existing(self.root, "the .dmap files")
        paths = sorted(path for path in root.glob(self.dmaps) if path.is_file())
        if not paths:
            raise InputError(
                f"{root / self.dmaps}: no depth map; run DensifyPointCloud there or set dataset.dmaps=..."
            )
        images = ImageFolder(root)
        photographs = []
        for path in track(paths, "depth maps"):
            header = read_header(path)
            name, fault = images.find_one(header.image, path.name)
            pose = scaled_pose(header.cam_from_world, self.metres_per_unit)
            photographs.append(
                Photograph(
                    name,
                    root / name,
                    Lens(header.camera),
                    pose,
                    path,
                    self._metres,
                    fault=fault,
                )
            )
        check_images((str(one.depth), one.name, one.fault) for one in photographs)
        yield scene_of(
            root.resolve().name,
            photographs,
            self.image_scale,
            self.encoding,
            self.metres_per_unit,
        )

    def _metres(self, path: Path) -> Array:
        return read_dmap_depth(path) * np.float32(self.metres_per_unit)


_REMEDY = "copy it again, or run DensifyPointCloud again"
_MOST_VIEWS = 100_000


@dataclass(frozen=True, eq=False)
class Header:
    """The header of a depth map."""

    image: str
    """Name of the image file in OpenMVS."""

    camera: Camera
    """At the image's size, pixel centres at +0.5."""

    cam_from_world: Array
    """Shape (4, 4), float64, in units of the reconstruction."""

    shape: tuple[int, int]
    """Height and width of the depths."""

    offset: int
    """Of the first depth, in bytes."""

    dtype: np.dtype[Any]
    """Of a stored depth."""

    factor: float
    """What a stored depth is multiplied by."""


def read_header(path: Path) -> Header:
    """Return the header of a depth map. Raises InputError if the file is no depth map, truncated, or has no camera."""
    with reading(path, _REMEDY), regular(path).open("rb") as file:

        def take(layout: str) -> tuple[Any, ...]:
            return struct.unpack("<" + layout, file.read(struct.calcsize("<" + layout)))

        magic = file.read(2)
        if magic not in (b"DR", b"D2"):
            raise ValueError("it starts with another mark")
        halves = magic == b"D2"
        flags, exponent = take("Bb")
        width, height, depth_width, depth_height = take("4I")
        take("3f" if halves else "2f")
        if (
            not flags & 1
            or not 0 < depth_width <= width <= 1 << 20
            or not 0 < depth_height <= height <= 1 << 20
        ):
            raise ValueError(
                f"flags {flags}, image {width}x{height}, depths {depth_width}x{depth_height}"
            )
        name = take(f"{take('H')[0]}s")[0].decode()
        views = take("I")[0]
        if views > _MOST_VIEWS:
            raise ValueError(f"{views} views")
        take(f"{views}I")
        numbers = np.array(take("21d"))
        K = numbers[:9].reshape(3, 3).copy()
        R = numbers[9:18].reshape(3, 3)
        cam_from_world = pose_of(R, -R @ numbers[18:])
        if not (
            np.isfinite(K).all() and min(K[0, 0], K[1, 1]) > 0 and np.allclose(K[2], (0, 0, 1))
        ):
            raise ValueError("its K is no camera's")
        if not is_rigid(cam_from_world):
            raise ValueError("its R and C are no pose")
        K[:2, 2] += 0.5
        camera, dtype = Camera(K, width, height), np.dtype("<f2" if halves else "<f4")
        factor = 2.0**exponent if halves else 1.0
        return Header(
            name,
            camera,
            cam_from_world,
            (depth_height, depth_width),
            file.tell(),
            dtype,
            factor,
        )


def read_dmap_depth(path: Path) -> Array:
    """Return the depths (H, W) float32, in units of the reconstruction. Raises InputError if they are truncated."""
    header = read_header(path)
    count = header.shape[0] * header.shape[1]
    with path.open("rb") as file:
        there = os.fstat(file.fileno()).st_size - header.offset
        if there < count * header.dtype.itemsize:  # before memory of that size is allocated
            raise DamagedFileError(
                f"cut short, its depths need {count * header.dtype.itemsize} bytes",
                path,
                _REMEDY,
            )
        file.seek(header.offset)
        stored = np.fromfile(file, header.dtype, count).reshape(header.shape)
    return np.asarray(stored.astype(np.float32) * np.float32(header.factor))
