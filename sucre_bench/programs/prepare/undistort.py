"""Writes pinhole images and a pinhole model, from photos and their model."""

from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array
from sucre_bench.camera import Camera
from sucre_bench.imaging.image_files import decode, write_png
from sucre_bench.loading.colmap_model import Posed, read_model
from sucre_bench.loading.lens import Lens
from sucre_bench.machine.compute import usable_cores
from sucre_bench.machine.progress import track
from sucre_bench.programs.prepare.photos import Photo, read_photo
from sucre_bench.programs.prepare.registered_photos import load_pycolmap


def undistort(photos: Mapping[str, Photo], model: Path, images: Path, masks: Path, pinhole: Path) -> None:
    """Write the undistorted images, PNG of the photos' own bit depth, their masks, and the model of them.

    photos: by output name; model: folder of the COLMAP model of the photos; images, masks, pinhole: folders to write
    into. An existing image is not written again.
    """
    posed = read_model(model, images, distorted=True)
    with ThreadPoolExecutor(usable_cores()) as pool:
        for _ in track(
            pool.map(lambda p: _undistort(photos[p.name], p, images, masks), posed), "undistorting", len(posed)
        ):
            pass
    write_pinhole({p.name: p for p in posed}, model, pinhole)


def _undistort(photo: Photo, posed: Posed, images: Path, masks: Path) -> None:
    import cv2

    target = images / posed.name
    if target.is_file():
        return
    if photo.mask is not None:
        mask = cv2.resize(decode(photo.mask, cv2.IMREAD_GRAYSCALE), photo.size, interpolation=cv2.INTER_NEAREST)
        write_png(masks / posed.name, np.where(_straight(np.asarray(mask), posed.lens) > 127, 255, 0).astype(np.uint8))
    write_png(target, _straight(read_photo(photo), posed.lens))


def _straight(image: npt.NDArray[Any], lens: Lens | None) -> npt.NDArray[Any]:
    """An image of the lens's size, undistorted; in its own type, because floats take four times the memory."""
    return image if lens is None else lens.resampled(image, lens.pinhole)


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
        lens, camera = cameras.setdefault(image.camera_id, (posed[image.name].lens, posed[image.name].camera))
        for place, (point, xy) in enumerate(zip(image.points2D, _straightened(lens, image.points2D), strict=True)):
            if not np.isfinite(xy).all() and point.has_point3D():  # outside the pinhole image
                known.delete_observation(number, place)
            point.xy = xy if np.isfinite(xy).all() else (-1.0, -1.0)
    for number, (_, camera) in cameras.items():
        of_file = known.camera(number)
        of_file.model = pycolmap.CameraModelId.PINHOLE
        of_file.params = [camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]]
    pinhole.mkdir(parents=True, exist_ok=True)
    known.write_binary(pinhole)


def _straightened(lens: Lens | None, points: Iterable[Any]) -> Array:
    """The features' places (P, 2) in the pinhole image, NaN outside."""
    xy = np.array([point.xy for point in points])
    return xy if lens is None or not len(xy) else lens.straightened(xy)
