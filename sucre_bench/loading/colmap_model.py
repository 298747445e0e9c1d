"""Reads the cameras and poses of a COLMAP sparse model, binary or text, and makes a scene of it and its images' files.

Only cameras.{bin,txt} and images.{bin,txt} are read. The 2-D and 3-D points are skipped, so a dive of thousands of
images takes a moment. The reader is our own because pycolmap hangs on a truncated images.bin or points3D.bin, and
accepts a camera from a truncated cameras.bin. Rigs and frames (from COLMAP 3.12) change nothing: images.* still has the
pose of every registered image.
Source of the format: https://colmap.github.io/format.html
"""

import math
import mmap
import os
import re
import shlex
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.camera import Camera, intrinsics, pose_of
from sucre_bench.errors import DamagedFileError, InputError, MissingFileError, file_error
from sucre_bench.imaging.image_files import image_size
from sucre_bench.loading.charts_file import read_charts
from sucre_bench.loading.depth_maps import find_depths
from sucre_bench.loading.find_folders import ImageFolder, inner_path
from sucre_bench.loading.lens import Lens
from sucre_bench.loading.view_files import Photograph, scaled_pose, scene_of
from sucre_bench.machine.files import NO_FILE, fault_of, regular
from sucre_bench.machine.progress import say, track
from sucre_bench.machine.text_formats import first_few, natural_order
from sucre_bench.scene import Encoding, Scene

# By their number in cameras.bin.
_CAMERA_MODELS = (
    *(
        "SIMPLE_PINHOLE",
        "PINHOLE",
        "SIMPLE_RADIAL",
        "RADIAL",
        "OPENCV",
        "OPENCV_FISHEYE",
        "FULL_OPENCV",
        "FOV",
    ),
    *(
        "SIMPLE_RADIAL_FISHEYE",
        "RADIAL_FISHEYE",
        "THIN_PRISM_FISHEYE",
        "RAD_TAN_THIN_PRISM_FISHEYE",
    ),
    *("SIMPLE_DIVISION", "DIVISION", "SIMPLE_FISHEYE", "FISHEYE", "EUCM", "EQUIRECTANGULAR"),
)
# How many parameters a model has; all start with one focal length or two, and the principal point.
_PARAMETERS = {
    "SIMPLE_PINHOLE": 3,
    "PINHOLE": 4,
    "SIMPLE_RADIAL": 4,
    "RADIAL": 5,
    "OPENCV": 8,
    "FULL_OPENCV": 12,
}
_PARAMETERS |= {"OPENCV_FISHEYE": 8, "SIMPLE_RADIAL_FISHEYE": 4, "RADIAL_FISHEYE": 5}
_PINHOLE = ("SIMPLE_PINHOLE", "PINHOLE")
_ONE_FOCAL = (
    "SIMPLE_PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "SIMPLE_RADIAL_FISHEYE",
    "RADIAL_FISHEYE",
)
_DRIVE = re.compile(r"[A-Za-z]:[\\/]|\\\\")  # of a path of Windows
_MOST_MISSING = 100  # images; of more, one view tells: each view costs time, memory and a row
_REMEDY = "copy the model again, or export it with 'colmap model_converter'"


@dataclass(frozen=True, eq=False)
class Posed:
    """A registered image."""

    name: str

    camera: Camera
    """At the model's size. If the stored image is distorted, it is that of the undistorted image."""

    cam_from_world: Array
    """Shape (4, 4), float64."""

    lens: Lens | None = None
    """Of the stored image, if that is distorted."""


# A row of either file, before it is checked.
# id, model, width, height, parameters
_CameraRow = tuple[int, str, int, int, tuple[float, ...]]
_ImageRow = tuple[tuple[float, ...], int, str]  # qw qx qy qz tx ty tz, camera id, name
_Row = TypeVar("_Row")


def read_model(
    sparse: Path,
    images: Path,
    distorted: bool = False,
    remedy: str = "",
    keep_names: bool = False,
) -> list[Posed]:
    """Return the registered images of the model in `sparse` or `sparse`/0, ordered by name.

    images: the image folder. Images with absolute paths, of another computer perhaps, are found in it by the end of
    their paths; if none of the images is there, all are. distorted: accept distorted cameras; remedy: what accepts
    them; keep_names: name images as the model does.
    Raises InputError if there is no model, if it cannot be read or is empty. Also if a camera is distorted and not
    accepted, of an unknown model, or cannot be undistorted, or if an image name occurs twice or leaves the folder.
    """
    places = [
        (folder, suffix) for folder in (sparse, sparse / "0") for suffix in (".bin", ".txt")
    ]
    pairs = (
        (folder / f"cameras{suffix}", folder / f"images{suffix}") for folder, suffix in places
    )
    found = next((pair for pair in pairs if pair[0].is_file() and pair[1].is_file()), None)
    if found is None:
        kind, fault = (
            (InputError, "holds no COLMAP model")
            if sparse.is_dir()
            else (MissingFileError, "no such folder")
        )
        raise kind(
            fault,
            sparse,
            "put cameras.bin and images.bin (or .txt) there or set dataset.sparse=DIR",
        )
    cameras_file, images_file = found
    paths = {
        "image": images,
        "input": cameras_file.parent,
        "output": sparse.parent / "undistorted",
    }
    given = " ".join(f"--{name}_path {shlex.quote(str(path))}" for name, path in paths.items())
    undistort = f"colmap image_undistorter {given} --output_type COLMAP"
    cameras = _read_cameras(
        cameras_file, distorted, f"{remedy} or undistort: {undistort}".removeprefix(" or ")
    )
    posed: dict[str, Posed] = {}
    for pose, number, name in _rows(
        images_file, _binary_images if images_file.suffix == ".bin" else _text_images
    ):
        place = f"{images_file}: image '{name}'"
        path = PurePosixPath(name)
        if not path.name or "\0" in name or ".." in path.parts:
            raise InputError(
                f"{place} is outside of the image folder, or no file; names must be relative to {images}"
            )
        if name in posed:
            raise InputError(
                f"{place} is there twice; every image needs a name of its own, rename and export again"
            )
        if number not in cameras:
            raise InputError(
                f"{place} has camera {number}, which {cameras_file.name} does not hold; {_REMEDY}"
            )
        camera, distortion = cameras[number]
        posed[name] = Posed(name, camera, _rigid(pose, place), distortion)
    if not posed:
        raise InputError(
            "no image is registered",
            images_file,
            "run 'colmap mapper' on more, overlapping images",
        )
    if not keep_names:
        posed = _named_as_files(posed, images)
    return [posed[name] for name in sorted(posed, key=natural_order)]


def _named_as_files(posed: dict[str, Posed], images: Path) -> dict[str, Posed]:
    """Return images by the names of their files, if the model has other paths. InputError if two have one file."""
    foreign = [name for name in posed if name.startswith("/") or _DRIVE.match(name)]
    if not foreign and any((images / name).is_file() for name in posed):
        return posed
    folder = ImageFolder(images)
    files = dict.fromkeys(posed, "")
    for name in foreign or posed:
        fits = folder.find(name)
        files[name] = fits[0] if len(fits) == 1 else inner_path(name)
    named: dict[str, Posed] = {}
    for name, one in posed.items():
        file = files[name] or name
        if file in named:
            raise InputError(
                f"is the image of '{name}' and of another name of the model",
                images / file,
                "keep the folders of the images that the model names",
            )
        named[file] = replace(one, name=file)
    moved = next(
        (name for name, file in files.items() if file and (images / file).is_file()), ""
    )
    if moved:
        say(
            f"{images}: the model's images are found by the end of their paths: '{moved}' is {files[moved]}"
        )
    return named


def _read_cameras(
    file: Path, distorted: bool, remedy: str
) -> dict[int, tuple[Camera, Lens | None]]:
    """Return each camera, undistorted, with its lens if that distorts. remedy: for one not accepted."""
    cameras: dict[int, tuple[Camera, Lens | None]] = {}
    read = _binary_cameras if file.suffix == ".bin" else _text_cameras
    for number, model, width, height, parameters in _rows(file, read):
        place = f"{file}: camera {number}"
        if model not in (_PARAMETERS if distorted else _PINHOLE):
            usable = (
                "of these distortions none is known here"
                if distorted
                else "only pinhole cameras can be used"
            )
            raise InputError(f"{place} is {model}, {usable}; {remedy}")
        focals = parameters[: 1 if model in _ONE_FOCAL else 2]
        is_size = 0 < min(width, height) <= max(width, height) <= 1e6  # what `Camera` takes
        if not (is_size and min(focals) > 0 and all(abs(value) <= 1e9 for value in parameters)):
            which = f"{width}x{height} with parameters {parameters}"
            raise InputError(f"{place} is {which}, which no camera has; {_REMEDY}")
        lens = lens_of_model(model, width, height, parameters)
        if model in _PINHOLE:
            cameras[number] = (lens.camera, None)
        elif lens.fault:
            raise InputError(
                f"{place} is {model} with parameters {parameters}, {lens.fault}; {remedy}"
            )
        else:
            cameras[number] = (lens.pinhole, lens)
    return cameras


def count_points(file: Path) -> int:
    """Return the number of points in a points3D.bin. Raises InputError if it breaks off."""
    return sum(1 for _ in _rows(file, _binary_points))


def lens_of_model(model: str, width: int, height: int, parameters: Sequence[float]) -> Lens:
    """Return a camera of COLMAP with its distortion, none for a pinhole. parameters: in COLMAP's order."""
    inner = 3 if model in _ONE_FOCAL else 4  # focal length, or both, and principal point
    focal_x, focal_y, x, y = parameters[:4] if inner == 4 else (parameters[0], *parameters[:3])
    camera = Camera(intrinsics(focal_x, focal_y, x, y), width, height)
    return Lens(
        camera, "fisheye" if "FISHEYE" in model else "perspective", tuple(parameters[inner:])
    )


def _rigid(pose: tuple[float, ...], place: str) -> Array:
    """Return (4, 4) from the quaternion w, x, y, z and translation that take a world point to the camera's frame."""
    length = math.hypot(*pose[:4])
    if not (all(map(math.isfinite, pose)) and length > 0):
        raise InputError(f"{place} has no usable pose; {_REMEDY}")
    w, x, y, z = (q / length for q in pose[:4])
    rotation = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return pose_of(np.array(rotation), np.array(pose[4:]))


def _rows(path: Path, read: Callable[[Path], Iterator[_Row]]) -> Iterator[_Row]:
    """Run one of the readers below; any fault becomes an InputError that names the file."""
    try:
        yield from read(path)
    except OSError as fault:
        raise file_error(path, fault, "check its permissions") from fault
    except (struct.error, ValueError) as fault:
        raise DamagedFileError(
            f"breaks off or is not a COLMAP file ({fault})", path, _REMEDY
        ) from fault


# -- binary: little-endian, no padding ---------------------------------------------------------------------


def _opened(path: Path) -> mmap.mmap:
    with regular(path).open("rb") as file:
        return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)


def _taken(data: mmap.mmap, layout: str) -> tuple[Any, ...]:
    return struct.unpack(f"<{layout}", data.read(struct.calcsize(f"<{layout}")))


def _binary_cameras(path: Path) -> Iterator[_CameraRow]:
    data = _opened(path)
    for _ in range(_taken(data, "Q")[0]):
        number, code, width, height = _taken(data, "IiQQ")
        if not 0 <= code < len(_CAMERA_MODELS):
            raise ValueError(f"camera model {code} is unknown")
        model = _CAMERA_MODELS[code]
        yield number, model, width, height, _taken(data, f"{_PARAMETERS.get(model, 0)}d")


def _binary_images(path: Path) -> Iterator[_ImageRow]:
    data = _opened(path)
    for _ in range(_taken(data, "Q")[0]):
        _, *pose, camera = _taken(data, "I7dI")
        length = data.find(b"\0", data.tell()) - data.tell()
        if length < 0:
            raise ValueError("a name does not end")
        name = data.read(length + 1)[:-1].decode()
        size = 24 * _taken(data, "Q")[0]  # of its points: x, y (2 d) and the 3-D point's id (Q)
        if size > len(data) - data.tell():
            raise ValueError("the points of an image break off")
        data.seek(size, os.SEEK_CUR)
        yield tuple(pose), camera, name


def _binary_points(path: Path) -> Iterator[int]:
    data = _opened(path)
    for _ in range(_taken(data, "Q")[0]):
        data.seek(43, os.SEEK_CUR)  # id, place, colour and error
        length: int = _taken(data, "Q")[0]
        data.seek(8 * min(length, len(data)), os.SEEK_CUR)
        yield length


# -- text --------------------------------------------------------------------------------------------------


def _text_cameras(path: Path) -> Iterator[_CameraRow]:
    with regular(path).open(encoding="utf-8-sig") as lines:
        for line in lines:
            if not line.strip() or line.startswith("#"):
                continue
            words = line.split()
            if len(words) < 5 or len(words) - 4 != _PARAMETERS.get(words[1], len(words) - 4):
                raise ValueError(f"no camera is written '{line.strip()}'")
            yield (
                int(words[0]),
                words[1],
                int(words[2]),
                int(words[3]),
                tuple(map(float, words[4:])),
            )


# COLMAP writes it at the head of images.txt.
_IN_ALL = re.compile(r"# Number of images: (\d+)")


def _text_images(path: Path) -> Iterator[_ImageRow]:
    """Two lines an image; the second holds its points, and is empty if it has none."""
    n_said = n_read = 0
    with regular(path).open(encoding="utf-8-sig") as lines:
        for line in lines:
            if not line.strip() or line.startswith("#"):
                said = _IN_ALL.match(line)
                n_said = int(said[1]) if said else n_said
                continue
            # the name is the rest of the line: it may hold spaces
            words = line.strip().split(maxsplit=9)
            if len(words) < 10:
                raise ValueError(f"no image is written '{line.strip()}'")
            points = next(lines, "").rsplit(maxsplit=1)
            if points and not points[-1].lstrip("-").isdigit():
                raise ValueError(
                    f"after image '{words[-1]}' stands no line of points, not even an empty one"
                )
            n_read += 1
            yield tuple(map(float, words[1:8])), int(words[8]), words[9]
    if n_read < n_said:
        say(f"{path}: holds {n_read} of the {n_said} images that its head names; it may be cut")


def registered_scene(
    name: str,
    model: Sequence[Posed],
    paths: Mapping[str, Path],
    depths: Path,
    image_scale: float = 1.0,
    encoding: Encoding = "gamma",
    metres_per_unit: float = 1.0,
    references: Mapping[str, Path] | None = None,
    charts: Path | None = None,
) -> Scene:
    """Return the scene of a model's registered images, undistorted when they are decoded. Reads headers only.

    paths: the file of each image of the model, by name; depths: folder of depth maps in metres, of the undistorted
    images (may be missing); metres_per_unit: factor for the model's lengths; references: the image without water of
    each image that has one, distorted like it; charts: see `charts_file` (may be missing).
    Raises MissingFileError if no image exists. A fault in the files of one view becomes a fault of that view. If more
    than 100 images are missing, only the first of them is a view, whose fault says how many are.
    """
    faults = {name: fault_of(path) for name, path in paths.items()}
    wrong = {name: fault for name, fault in faults.items() if fault}
    of = f"of the model's {len(paths)} images"
    if len(wrong) == len(paths):
        raise MissingFileError(
            f"none {of} is there", next(iter(paths.values())), "copy them there"
        )
    missing = [name for name, fault in wrong.items() if fault == NO_FILE]
    no_views = set(missing[1:]) if len(missing) > _MOST_MISSING else set[str]()
    remedies = {
        name: f" ({len(missing)} {of} are missing: {first_few(missing, 3)}); copy them"
        for name in missing
    }
    unusable = {
        name: f"{paths[name]}: {why}{remedies.get(name, '; copy it')} there"
        for name, why in wrong.items()
        if name not in no_views
    }
    sizes = {
        posed.name: (posed.name not in wrong and image_size(paths[posed.name]))
        or posed.camera.size
        for posed in track(model, "image sizes")
    }
    found = find_depths(depths, list(paths))
    seen = {} if charts is None else read_charts(charts, sizes)
    photographs = [
        Photograph(
            image := posed.name,
            paths[image],
            posed.lens or Lens(posed.camera),
            scaled_pose(posed.cam_from_world, metres_per_unit),
            found.get(image),
            reference=(references or {}).get(image),
            charts=seen.get(image, ()),
            charts_file=charts,
            size=sizes[image],
            fault=unusable.get(image, ""),
        )
        for posed in model
        if posed.name not in no_views
    ]
    return scene_of(name, photographs, image_scale, encoding)
