"""Registered photos for the stages after mapping: undistorted images, pinhole cameras, poses, and their sparse points.

pycolmap is imported here and nowhere else.
"""

import errno
import signal
import threading
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array
from sucre_bench.camera import Camera, moved, project
from sucre_bench.imaging.image_files import OF_JPEG, is_jpeg, write_png
from sucre_bench.loading.colmap_model import Posed, read_model
from sucre_bench.loading.lens import Lens
from sucre_bench.machine.compute import usable_cores
from sucre_bench.machine.files import not_writable
from sucre_bench.machine.progress import track
from sucre_bench.machine.provenance import load, require
from sucre_bench.programs.prepare.photos import Photo, read_mask, read_photo


def load_pycolmap(place: str = "prepare") -> ModuleType:
    """Return pycolmap with its log switched off. place: the command that needs it.

    Raises InputError if it or Open3D is missing or too old, or if it does not import.
    """
    # pycolmap's wheel has its own zlib, png and jpeg. If it were the first to load them, writing a PNG later
    # would abort the process.
    import zlib  # noqa: F401

    import cv2  # noqa: F401

    pycolmap: ModuleType = load(place, "pycolmap")  # first: its extra has Open3D too
    require(place, "open3d")
    pycolmap.logging.minloglevel = pycolmap.logging.FATAL.value
    if threading.current_thread() is threading.main_thread():  # it alone may set handlers
        signal.signal(signal.SIGABRT, signal.SIG_DFL)  # without a page of COLMAP's stack
    return pycolmap


def undistort(
    photos: Mapping[str, Photo], model: Path, images: Path, masks: Path, pinhole: Path
) -> None:
    """Write the undistorted images, PNG of the photos' own bit depth, their masks, and the model of them.

    photos: by output name; model: folder of the COLMAP model of the photos; images, masks, pinhole: folders to write
    into. An existing image is not written again. The image of a JPEG photo says that it is one.
    """
    posed = read_model(model, images, distorted=True)

    def write(one: Posed) -> None:
        photo = photos[one.name]
        lens = one.lens
        if (images / one.name).is_file():
            return
        if photo.mask is not None:
            mask = read_mask(photo.mask, photo.size)
            mask = mask if lens is None else lens.resampled(mask, lens.pinhole)
            write_png(masks / one.name, np.where(mask > 127, 255, 0).astype(np.uint8))
        image = read_photo(photo)  # stays in its own type: floats take four times the memory
        straight = image if lens is None else lens.resampled(image, lens.pinhole)
        write_png(images / one.name, straight, chunk=OF_JPEG if is_jpeg(photo.path) else b"")

    with ThreadPoolExecutor(usable_cores()) as pool:
        list(track(pool.map(write, posed), "undistorting", len(posed)))
    write_pinhole({p.name: p for p in posed}, model, pinhole)


def write_pinhole(posed: Mapping[str, Posed], model: Path, pinhole: Path) -> None:
    """Write the COLMAP model of the undistorted images into the folder `pinhole`.

    posed: the photos by output name, with lens and pinhole camera; model: folder of the photos' own model. Features
    outside the pinhole images belong to no point any more.
    """
    pycolmap = load_pycolmap()
    known = pycolmap.Reconstruction(model)
    cameras: dict[int, tuple[Lens | None, Camera]] = {}
    for number in known.reg_image_ids():
        image = known.image(number)
        lens, camera = cameras.setdefault(
            image.camera_id, (posed[image.name].lens, posed[image.name].camera)
        )
        places = np.array([point.xy for point in image.points2D]).reshape(-1, 2)
        if lens is not None and len(places):
            places = lens.straightened(places)  # NaN outside the pinhole image
        for index, (point, xy) in enumerate(zip(image.points2D, places, strict=True)):
            if not np.isfinite(xy).all() and point.has_point3D():
                known.delete_observation(number, index)
            point.xy = xy if np.isfinite(xy).all() else (-1.0, -1.0)
    for number, (_, camera) in cameras.items():
        of_file = known.camera(number)
        of_file.model = pycolmap.CameraModelId.PINHOLE
        of_file.params = [camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]]
    write_model(known, pinhole)


def write_model(model: Any, folder: Path) -> None:
    """Write a COLMAP model. Raises OutputError if the disk is full: COLMAP leaves files cut short and says nothing."""
    folder.mkdir(parents=True, exist_ok=True)
    model.write_binary(folder)
    size = 8 + sum(51 + 8 * point.track.length() for point in model.points3D.values())
    if (folder / "points3D.bin").stat().st_size < size:  # the last file that it writes
        raise not_writable(folder, OSError(errno.ENOSPC, ""))


@dataclass(frozen=True, eq=False, slots=True)
class Shot:
    """A registered photo. Lengths are in the model's unit."""

    name: str
    """Of the undistorted image."""

    camera: Camera
    """Pinhole, at the image's size."""

    cam_from_world: Array
    """(4, 4) float64."""

    point_ids: npt.NDArray[np.int64]
    """(P,) of the sparse points seen, sorted."""

    points: Array
    """(P, 3) float64 in the world."""

    xy: Array
    """(P, 2) float64, the pixels of the points' features."""

    tracks: npt.NDArray[np.int64]
    """(P,), number of photos that see each point."""

    @property
    def centre(self) -> Array:
        """(3,) the camera's centre in the world."""
        return np.asarray(-self.cam_from_world[:3, :3].T @ self.cam_from_world[:3, 3])

    def seen_points(self) -> tuple[Array, Array]:
        """The points' projections (P, 2) and planar depths (P,)."""
        return project(self.camera, moved(self.points, self.cam_from_world))


def read_shots(model: Path) -> list[Shot]:
    """Return the photos of an undistorted COLMAP model, ordered by name."""
    known = load_pycolmap().Reconstruction(model)
    places = {
        number: (point.xyz, point.track.length()) for number, point in known.points3D.items()
    }
    shots = []
    for image in map(known.image, known.reg_image_ids()):
        camera = known.camera(image.camera_id)
        pose = np.eye(4)
        pose[:3] = image.cam_from_world().matrix()
        seen = sorted(
            (p.point3D_id, *p.xy, *places[p.point3D_id][0])
            for p in image.get_observation_points2D()
        )
        ids = np.array([number for number, *_ in seen], dtype=np.int64)
        values = np.array([row[1:] for row in seen], dtype=np.float64).reshape(-1, 5)
        tracks = np.array([places[number][1] for number in ids.tolist()], dtype=np.int64)
        pinhole = Camera(np.array(camera.calibration_matrix()), camera.width, camera.height)
        shots.append(Shot(image.name, pinhole, pose, ids, values[:, 2:], values[:, :2], tracks))
    return sorted(shots, key=lambda shot: shot.name)
