"""From photos and their model to pinhole images and a pinhole model."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from sucre_bench.images import decode
from sucre_bench.loading.colmap_model import Posed, read_model
from sucre_bench.loading.lens import Lens
from sucre_bench.prepare.colmap import load_pycolmap
from sucre_bench.prepare.photos import Photo, read_photo, write_png
from sucre_bench.progress import track
from sucre_bench.scene import Array, Camera
from sucre_bench.threads import usable_cores

__all__ = ["undistort"]


def undistort(photos: Mapping[str, Photo], model: Path, images: Path, masks: Path, pinhole: Path) -> None:
    """Write the undistorted images, PNG of the photos' own bit depth, their masks, and the model of them.

    photos: by output name; model: folder of the COLMAP model of the photos; images, masks, pinhole: folders to write
    into. An image that is there already is kept.
    """
    posed = read_model(model, images, distorted=True)
    with ThreadPoolExecutor(usable_cores()) as pool:
        for _ in track(
            pool.map(lambda p: _undistort(photos[p.name], p, images, masks), posed), "undistorting", len(posed)
        ):
            pass
    _write_pinhole({p.name: p for p in posed}, model, pinhole)


def _undistort(photo: Photo, posed: Posed, images: Path, masks: Path) -> None:
    import cv2

    target = images / posed.name
    if target.is_file():
        return
    if photo.mask is not None:
        mask = decode(photo.mask, cv2.IMREAD_GRAYSCALE).astype(np.float32)
        mask = np.asarray(cv2.resize(mask, photo.size, interpolation=cv2.INTER_NEAREST), dtype=np.float32)
        straight = mask if posed.lens is None else posed.lens.undistorted(mask, photo.size)
        write_png(masks / posed.name, np.where(straight > 127, 255, 0).astype(np.uint8))
    stored = read_photo(photo)
    if posed.lens is not None:
        straight = posed.lens.undistorted(stored.astype(np.float32), photo.size)
        stored = np.clip(np.rint(straight), 0, np.iinfo(stored.dtype).max).astype(stored.dtype)
    write_png(target, stored)


def _write_pinhole(posed: Mapping[str, Posed], model: Path, pinhole: Path) -> None:
    pycolmap = load_pycolmap()
    known = pycolmap.Reconstruction(model)
    cameras: dict[int, tuple[Lens | None, Camera]] = {}
    for number in known.reg_image_ids():
        image = known.image(number)
        lens, camera = cameras.setdefault(image.camera_id, (posed[image.name].lens, posed[image.name].camera))
        for point, xy in zip(image.points2D, _straight(lens, camera, image.points2D), strict=True):
            point.xy = xy
    for number, (_, camera) in cameras.items():
        own = known.camera(number)
        own.model = pycolmap.CameraModelId.PINHOLE
        own.params = [camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]]
    pinhole.mkdir(parents=True, exist_ok=True)
    known.write_binary(pinhole)


def _straight(lens: Lens | None, camera: Camera, points: object) -> Array:
    xy = np.array([point.xy for point in points])  # type: ignore[attr-defined]
    return xy if lens is None or not len(xy) else lens.rays(xy) @ camera.K[:2, :2].T + camera.K[:2, 2]
