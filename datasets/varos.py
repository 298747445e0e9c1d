"""VAROS: a synthetic deep-sea dive, with the same views without water, depth and poses.

    .../vehicle0/cam0/A/seq01_veh0_camM0_A-00000000.png   the view in water: RGB, 1280x720
                      B/...B-00000000.png                 without water, evenly lit: the reference
                      D/...D-00000000.png                 depth, uint16: metres = value / 65535 * 25
                      camM0.yaml                          focal_length, sensor_width, resolution
                      camM0_timestamps.csv                nanoseconds, and the files of that time
                      camM0_poses/camM0_poses_transformation_matrix.csv

Conventions. Depth is planar. Poses map camera to world, and the camera looks along +z, x right, y down, as in OpenCV,
not as in Blender. The files do not say so. Code of one of the data's authors multiplies the inverse intrinsic matrix by
the depth, and the result by the pose, without turning an axis. Others warp one view into another in the same way.
Pixels are square: Blender leaves sensor_height unused. The last depth value, 25 m, means "that far or farther". Source:
Zwilgmeyer et al., The VAROS synthetic underwater data set, ICCV Workshops 2021.
"""

import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench import Camera, dataset
from sucre_bench.arrays import Array
from sucre_bench.camera import centred_camera, is_rigid, pose_of
from sucre_bench.errors import InputError, MissingFileError
from sucre_bench.imaging.image_files import PICTURE_READERS
from sucre_bench.loading.depth_maps import read_depth
from sucre_bench.loading.find_folders import existing, folders_below, scene_name
from sucre_bench.loading.lens import Lens
from sucre_bench.loading.view_files import ImageScaleOption, Photograph, scene_of
from sucre_bench.machine.files import reading, regular
from sucre_bench.machine.text_formats import read_yaml
from sucre_bench.scene import Scene

_FAR_M = 25.0
_FAR_VALUE = 65535
_CAMERA = "camM0.yaml"
_TIMES = "camM0_timestamps.csv"
_POSES = "camM0_poses/camM0_poses_transformation_matrix.csv"
_MATRIX = (
    "r11",
    "r12",
    "r13",
    "r21",
    "r22",
    "r23",
    "r31",
    "r32",
    "r33",
    "s_x_vw",
    "s_y_vw",
    "s_z_vw",
)
# Time stamps passed through float32 (4999936 for 5 ms), and clocks start up to 5 ms apart. Frames are 100 ms apart.
_SAME_TIME_NS = 10_000_000


@dataset(
    requires=PICTURE_READERS,
    has=("poses", "depth", "reference"),
    cites="Zwilgmeyer, Yip, Teigen, Mester & Stahl 2021, ICCV Workshops",
    licence="as its download page says",
    source="https://www.ntnu.edu/arosvisiongroup/varos (4,715 frames of 1280x720, four files each)",
    proven="has read no released file yet: written from the authors' descriptions, tried on miniatures of them",
    signs=("camM0.yaml", "*/camM0.yaml", "*/*/camM0.yaml", "*/*/*/camM0.yaml"),
)
@dataclass(frozen=True)
class Varos(ImageScaleOption):
    """The VAROS dive: one scene for each folder below root that holds A/ (and B/, D/), views in order of frame."""

    root: Path
    """The download, or any folder in it from 2021-08-17_SEQ1 down to cam0 or to one's own train/ or val/."""

    def scenes(self) -> Iterator[Scene]:
        """Yield a scene for each camera folder. Reads camera, poses, headers and samples of files, no more.

        Raises InputError when there is no such folder, or its camera or poses are missing or wrong.
        """
        root = existing(self.root)
        lack = "holds no folder A of views in water; give the folder that holds vehicle0/cam0/A"
        for folder in folders_below(root, lambda _, below: "A" in below, lack):
            images = _frames(folder / "A")
            if not images:
                raise InputError(
                    f"{folder / 'A'}: holds no image that ends on a frame number; copy the PNG files there"
                )
            beside: dict[str, dict[int, Path | str]] = {
                plane: {**_frames(folder / plane)} for plane in "BD"
            }
            for plane, files in beside.items():
                for frame in images if files else ():
                    files.setdefault(
                        frame, f"{folder / plane}: no file of frame {frame}; copy it there"
                    )
            lens = Lens(_camera(_beside(folder, root, _CAMERA)))
            times = _times(_beside(folder, root, _TIMES), sorted(images))
            stamps, matrices = _poses(_beside(folder, root, _POSES))
            nearest = {
                frame: int(np.argmin(np.abs(stamps - time))) for frame, time in times.items()
            }
            poses = {
                n: matrices[k]
                for n, k in nearest.items()
                if abs(stamps[k] - times[n]) <= _SAME_TIME_NS
            }
            photographs = [
                Photograph(
                    path.relative_to(folder / "A").as_posix(),
                    path,
                    lens,
                    poses.get(frame),
                    beside["D"].get(frame),
                    partial(read_depth, unit=_FAR_M / _FAR_VALUE),
                    reference=beside["B"].get(frame),
                )
                for frame, path in sorted(images.items())
            ]
            yield scene_of(scene_name(folder, root), photographs, self.image_scale)


def _frames(folder: Path) -> dict[int, Path]:
    """Return the PNG files in a folder, and those it holds, by the number that their names end on."""
    found: dict[int, Path] = {}
    for path in sorted(folder.rglob("*.png")):
        number = re.search(r"(\d+)$", path.stem)
        if number is None:
            continue
        other = found.setdefault(int(number[1]), path)
        if other != path:
            raise InputError(
                f"{path}: frame {int(number[1])} is also {other}; keep one of them"
            )
    return found


def _beside(folder: Path, root: Path, name: str) -> Path:
    """Return a file of the camera: with its images, or above where they were split into folders of one's own."""
    places = [
        place for place in (folder, *folder.parents) if place == root or root in place.parents
    ]
    for place in places:
        for path in (place / name, place / Path(name).name):
            if path.is_file():
                return path
    raise MissingFileError(
        f"no such file, nor above, up to {root}", folder / name, "copy it from the download"
    )


# -- the camera and its poses ------------------------------------------------------------------------------


def _camera(path: Path) -> Camera:
    with reading(
        path, "give one with focal_length, sensor_width and resolution: width, height"
    ):
        text = regular(path).read_text(encoding="utf-8")
        # as OpenCV heads its files, which YAML refuses
        stored = read_yaml(re.sub(r"^%YAML.*\n", "", text))
        resolution = stored.get("resolution", stored)
        width, height = (
            resolution
            if isinstance(resolution, list)
            else (resolution["width"], resolution["height"])
        )
        focal = float(stored["focal_length"]) / float(stored["sensor_width"]) * width
        if not (focal > 0 and width > 0 and height > 0):
            raise ValueError(f"focal length {focal:g} px for {width}x{height}")
        return centred_camera(focal, int(width), int(height))


def _times(path: Path, frames: list[int]) -> dict[int, int]:
    """Return the time of each frame in nanoseconds, by the file names in its row, or by its order where all are there.

    Raises InputError when neither tells.
    """
    rows = [row for row in _rows(path) if row[0].strip().isdigit()]
    times: dict[int, int] = {}
    for row in rows:
        named = (re.search(r"-(\d+)(\.\w+)?\s*$", cell) for cell in row[1:])
        numbers = {int(match[1]) for match in named if match}
        if len(numbers) == 1:
            times[numbers.pop()] = int(row[0])
    if times:
        return times
    if len(rows) != len(frames):
        fault = f"{len(rows)} times that name no files, for {len(frames)} images"
        raise InputError(f"{path}: {fault}; use the file of the download, which names them")
    return {frame: int(row[0]) for frame, row in zip(frames, rows, strict=True)}


def _poses(path: Path) -> tuple[Array, Array]:
    """Return the times (N,) in nanoseconds, ascending, and cam_from_world (N, 4, 4)."""
    with reading(path, f"copy the file again, with a time in ns and {', '.join(_MATRIX)}"):
        header, *rows = _rows(path)
        names = [re.sub(r"\s*\[.*", "", cell).strip() for cell in header]
        columns = [0, *(names.index(name) for name in _MATRIX)]
        values = np.array([[float(row[k]) for k in columns] for row in rows], dtype=np.float64)
        world_from_cam = [pose_of(one[1:10].reshape(3, 3), one[10:]) for one in values]
        for number, pose in enumerate(world_from_cam, 2):
            if not is_rigid(pose):
                raise ValueError(f"row {number} holds no rotation")
        order = np.argsort(values[:, 0], kind="stable")
        return values[order, 0], np.linalg.inv(np.stack(world_from_cam)[order])


def _rows(path: Path) -> list[list[Any]]:
    with (
        reading(path, "copy the file again"),
        regular(path).open(encoding="utf-8-sig", newline="") as file,
    ):
        return [row for row in csv.reader(file) if row]
