"""SQUID: 57 stereo pairs from four sites in the Red Sea and the Mediterranean, with distances from stereo.

    Katzaa/stereoParams0.5.mat                              the pair of cameras, as MATLAB calibrated it
           image_set_01/LFT_4007resizedUndistort.tif        16 bit, 2737x1827, without lens distortion
                        RGT_4011resizedUndistort.tif
                        distanceFromCamera.mat              dist_map_l, dist_map_r: metres, NaN = unknown
    Michmoret/, Nachsholim/, Satil/                         likewise

Conventions. The maps hold distances from the camera's centre: each is divided by the length of its pixel's ray to
make planar depth. MATLAB's K stands transposed, with the first pixel's centre at (1, 1), here (0.5, 0.5). Its poses are
for row vectors, x2 = x1 R + t, lengths in millimetres unless it says otherwise. The world is the left camera. The
images are taken as linear: they stem from raw files and are dark as those are.
Source: Berman, Levy, Avidan & Treibitz, Underwater single image color restoration using haze-lines and a new
quantitative dataset, TPAMI 2021.
"""

import functools
import importlib
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.camera import Camera, is_rigid, pixel_rays, pose_of, scaled_camera
from sucre_bench.errors import InputError, MissingFileError
from sucre_bench.imaging.image_files import SUFFIXES, image_size
from sucre_bench.loading.charts_file import read_charts
from sucre_bench.loading.find_folders import check_chosen, existing, folders_below, scene_name
from sucre_bench.loading.lens import Lens
from sucre_bench.loading.view_files import ImageScaleOption, Photograph, scene_of
from sucre_bench.machine.files import expanded, reading, regular
from sucre_bench.plugins.plugin import dataset
from sucre_bench.scene import Encoding, Scene

_SIZE = (2737, 1827)  # of the images and maps, which the calibration was made at
_METRES = {
    "m": 1.0,
    "meters": 1.0,
    "cm": 0.01,
    "centimeters": 0.01,
    "mm": 0.001,
    "millimeters": 0.001,
}


@dataset(
    requires=("PIL", "cv2", "scipy", "tifffile"),
    has=("poses", "depth", "charts"),
    cites="Berman, Levy, Avidan & Treibitz 2021, TPAMI",
    licence="as its download page says",
    source="https://zenodo.org/records/5744037 (57 stereo pairs; raw files, TIFF and distance maps)",
    proven="has read no released file yet: written from the authors' descriptions, tried on miniatures of them",
    signs=("image_set_*", "*/image_set_*"),
)
@dataclass(frozen=True)
class Squid(ImageScaleOption):
    """The SQUID stereo pairs: one scene for each image set below root, of the left and the right view."""

    ranges: ClassVar = {"farthest_m": "(0, inf)"}

    root: Path
    """The download, one site of it or one image set."""
    encoding: Encoding = "linear"
    """How the images are encoded: "linear" as released, "gamma" for copies that were made for a screen."""
    farthest_m: float = 100.0
    """Distances beyond this are unknown, because stereo may give any length where it fails."""
    charts: str = "charts.json"
    """File of charts' corners in an image set's folder. charts.json need not exist; another name must, in one set."""

    def scenes(self) -> Iterator[Scene]:
        """Yield a scene for each image set. Reads calibrations, headers and samples of files, no more.

        Raises InputError when there is no set, a calibration is missing or cannot be read, or no set has the
        given charts.
        """
        root = existing(self.root)
        calibration = functools.cache(_calibration)
        lack = "holds no folder image_set_NN; give the folder of Katzaa, Michmoret and so on"
        folders = list(
            folders_below(
                root, lambda place, _: place.name.lower().startswith("image_set"), lack
            )
        )
        check_chosen(self, folders, "charts", "file")
        for folder in folders:
            files = [
                file
                for place in (folder.parent, folder)
                for file in sorted(place.glob("stereoParams*.mat"))
            ]
            if not files:
                where = folder.parent / "stereoParams0.5.mat"
                raise MissingFileError(
                    "no such file", where, "copy it from the site's download"
                )
            cameras, right_from_left = calibration(files[0])
            paths = [_image(folder, "LFT"), _image(folder, "RGT")]
            sizes = {
                path.name: image_size(path) or camera.size
                for path, camera in zip(paths, cameras, strict=True)
            }
            charts = read_charts(folder / expanded(self.charts), sizes)
            maps = folder / "distanceFromCamera.mat"
            photographs = [
                Photograph(
                    path.name,
                    path,
                    Lens(camera),
                    pose,
                    maps if maps.is_file() else None,
                    functools.partial(
                        _read_distance,
                        key=f"dist_map_{side}",
                        camera=camera,
                        farthest_m=self.farthest_m,
                    ),
                    charts=charts.get(path.name, ()),
                    size=sizes[path.name],
                )
                for path, camera, side, pose in zip(
                    paths, cameras, "lr", (np.eye(4), right_from_left), strict=True
                )
            ]
            yield scene_of(
                scene_name(folder, root),
                photographs,
                self.image_scale,
                self.encoding,
                self.farthest_m,
            )


def _image(folder: Path, side: str) -> Path:
    """Return the undistorted image of a side; where there is none, what it should be called."""
    found = sorted(p for p in folder.glob(f"{side}_*ndistort*") if p.suffix.lower() in SUFFIXES)
    named = sorted(p.stem for p in folder.glob(f"{side}_*")) or [f"{side}_"]
    return found[0] if found else folder / f"{named[0]}resizedUndistort.tif"


def _read_distance(path: Path, key: str, camera: Camera, farthest_m: float) -> Array:
    """Return planar metres (H, W) of one of a file's distance maps, NaN where unknown."""
    distance = _load(path, key).get(key)
    if not isinstance(distance, np.ndarray) or distance.ndim != 2 or distance.dtype.kind != "f":
        raise InputError(f"{path}: holds no map {key} of distances; copy the file again")
    rays = pixel_rays(scaled_camera(camera, distance.shape[::-1]))
    return np.where(distance <= farthest_m, distance / np.linalg.norm(rays, axis=-1), np.nan)


# -- the calibration ---------------------------------------------------------------------------------------


def _calibration(path: Path) -> tuple[tuple[Camera, Camera], Array]:
    """Return the left and the right camera, and the (4, 4) transform from the left one's frame, in metres."""
    stored: Any = _load(path)
    if _field(stored, "RotationOfCamera2") is None and "__function_workspace__" in stored:
        try:  # saved as an object of a MATLAB class, as released
            matio = importlib.import_module("matio")
        except ImportError as fault:
            remedy = "install mat-io (pip install mat-io), or in MATLAB save toStruct(stereoParams) to it"
            raise InputError(f"{path}: holds an object of a MATLAB class; {remedy}") from fault
        with reading(path, "in MATLAB save toStruct(stereoParams) to it"):
            stored = matio.load_from_mat(str(path))
    with reading(path, "copy the calibration of the two cameras again"):
        cameras = (
            _camera(_field(stored, "CameraParameters1")),
            _camera(_field(stored, "CameraParameters2")),
        )
        rotation, translation = (
            _numbers(_field(stored, f"{part}OfCamera2")) for part in ("Rotation", "Translation")
        )
        units = np.asarray(_plain(_field(stored, "WorldUnits"))).ravel()
        metres = _METRES[str(units[0]) if units.size else "mm"]
        right_from_left = pose_of(rotation.reshape(3, 3).T, translation.reshape(3) * metres)
        if not is_rigid(right_from_left):
            raise ValueError("RotationOfCamera2 is no rotation")
    return cameras, right_from_left


def _camera(parameters: Any) -> Camera:
    named = (
        _field(parameters, name) for name in ("IntrinsicMatrix", "IntrinsicMatrixInternal", "K")
    )
    stored = next((matrix for matrix in named if matrix is not None), None)
    K = _numbers(stored).reshape(3, 3)
    K = K if np.allclose(K[2], (0, 0, 1)) else K.T
    if not (np.allclose(K[2], (0, 0, 1)) and K[0, 0] > 0 and K[1, 1] > 0):
        raise ValueError(f"intrinsic matrix {K.tolist()}")
    K = K - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    size = _field(parameters, "ImageSize")
    rows_columns = () if size is None else tuple(_numbers(size).ravel())
    height, width = rows_columns if len(rows_columns) == 2 else _SIZE[::-1]
    return Camera(K, int(width), int(height))


def _field(value: Any, name: str) -> Any:
    """Return the first field of that name in what a MATLAB file holds, however deep; None when there is none."""
    value = getattr(value, "properties", value)
    if isinstance(value, np.ndarray) and value.dtype.names:
        value = {field: value[field] for field in value.dtype.names}
    if isinstance(value, dict):
        if name in value:
            return value[name]
        inner: Iterable[Any] = value.values()
    elif isinstance(value, np.ndarray) and value.dtype == object:
        inner = value.flat
    else:
        return None
    return next((found for item in inner if (found := _field(item, name)) is not None), None)


def _plain(value: Any) -> Any:
    """Return what a MATLAB value holds, out of the arrays of one element that it is read into."""
    while isinstance(value, np.ndarray) and value.dtype == object and value.size == 1:
        value = value.item()
    return [] if value is None else value


def _numbers(value: Any) -> Array:
    numbers = np.asarray(_plain(value), dtype=np.float64)
    if not math.isfinite(numbers.sum()):
        raise ValueError("a number is missing")
    return numbers


def _load(path: Path, variable: str | None = None) -> dict[str, Any]:
    """Return what a MATLAB file holds, or of it one variable."""
    import scipy.io

    with reading(path, "copy it again, or save it again as MATLAB's '-v7'"):
        return dict(scipy.io.loadmat(regular(path), variable_names=variable))
