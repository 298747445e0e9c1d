"""Scenes in nerfstudio's format, which instant-ngp, Blender's NeRF scenes, Polycam and RealityCapture users have too.

root/transforms.json      cameras and poses; or transforms_train.json, _val and _test, taken together
root/images/<name>        what its file_path names, with a suffix or without
root/depths/<name>        optional, what its depth_file_path or depth_path names, see `loading.depth_maps`

Poses are camera-to-world in OpenGL's axes: x right, y up, z back. cx, cy are in pixels with centres at +0.5. Depth is
planar, of the image as it is stored; a value times the unit factor is in metres, poses divided by applied_scale are.
Paths of another computer, and of converted images, are found by their last folder and name.
Source: https://docs.nerf.studio/quickstart/data_conventions.html
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path, PurePosixPath
from typing import Any, ClassVar

import numpy as np

from sucre_bench import Camera, dataset, track
from sucre_bench.arrays import Array
from sucre_bench.camera import intrinsics, is_rigid
from sucre_bench.errors import InputError, MissingFileError, in_one_line
from sucre_bench.imaging.image_files import PICTURE_READERS, SUFFIXES, decode, image_size
from sucre_bench.loading.depth_maps import DEPTH_SUFFIXES, depth_suffix, read_depth
from sucre_bench.loading.find_folders import (
    Found,
    ImageFolder,
    check_images,
    existing,
    inner_path,
    inside,
    without_suffix,
)
from sucre_bench.loading.lens import Lens, lens_of
from sucre_bench.loading.view_files import ImageScaleOption, Photograph, fingerprint, scene_of
from sucre_bench.machine.files import read_json, regular
from sucre_bench.machine.progress import say
from sucre_bench.scene import Encoding, Scene

_USUAL = (
    ("transforms.json",),
    ("transforms_train.json", "transforms_val.json", "transforms_test.json"),
)
_PERSPECTIVE = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE")
_FISHEYE = ("OPENCV_FISHEYE",)
_MILLIMETRE = 0.001  # nerfstudio's own depth_unit_scale_factor where nothing says another
# Keys by program: nerfstudio, instant-ngp, dense-depth-priors. A unit is metres, or stored values in a metre: power -1.
_DEPTHS = ("depth_file_path", "depth_path")
_UNITS = {"depth_unit_scale_factor": 1, "integer_depth_scale": 1, "depth_scaling_factor": -1}
# Keys that are read, or that say nothing of a view's pixels and camera.
_KNOWN = {
    *_DEPTHS,
    *_UNITS,
    "frames",
    "file_path",
    "mask_path",
    "transform_matrix",
    "applied_scale",
}
_KNOWN |= {
    "camera_model",
    "is_fisheye",
    "w",
    "h",
    "fl_x",
    "fl_y",
    "fx",
    "fy",
    "cx",
    "cy",
    "k1",
    "k2",
    "k3",
    "k4",
}
_KNOWN |= {
    "p1",
    "p2",
    "camera_angle_x",
    "camera_angle_y",
    "applied_transform",
    "aabb",
    "aabb_scale",
    "scale",
    "offset",
}
_KNOWN |= {
    "sharpness",
    "colmap_im_id",
    "ply_file_path",
    "near",
    "far",
    "rotation",
    "enable_depth_loading",
}
_Frame = Mapping[str, Any]


@dataset(
    requires=PICTURE_READERS,
    source="your own scenes, from ns-process-data, Polycam, RealityCapture, instant-ngp or Blender",
    proven="has read no file of these programs yet, only ours in their formats",
    has=("poses", "depth"),
    signs=("transforms.json", "transforms_train.json"),
)
@dataclass(frozen=True)
class Nerfstudio(ImageScaleOption):
    """A scene in nerfstudio's format: one view a frame of transforms.json, in order of name."""

    ranges: ClassVar = {"depth_scale": "(0, inf)"}

    root: Path
    """The folder that holds transforms.json and everything that it names."""
    transforms: str = ""
    """File of the cameras and poses, in root; empty: transforms.json, or else transforms_train, _val and _test.json."""
    depth_scale: float | None = None
    """Metres in a unit of the depth maps; none: what the file says (depth_unit_scale_factor, integer_depth_scale, or
    depth_scaling_factor units in a metre), or else 0.001."""
    encoding: Encoding = "gamma"
    """How images are encoded: "gamma" (sRGB-like) or "linear"."""

    def scenes(self) -> Iterator[Scene]:
        """Yield the one scene, named like its folder. Reads the JSON, headers and samples of files.

        Raises InputError for what concerns all views. That is no file or a damaged one, a path that leaves the folder,
        a camera or pose that is none, no image at all. What is wrong with the files of one view is raised when they are
        loaded.
        """
        root = existing(self.root, "transforms.json")
        found: list[tuple[str, Photograph]] = []  # with the place of its frame
        units = set()
        masks = []
        files = _Files(root)
        for path in self._files(root):
            content = read_json(path, "copy or export it again", of_data=True)
            frames = content.get("frames") if isinstance(content, dict) else None
            if (
                not isinstance(frames, list)
                or not frames
                or not all(isinstance(frame, dict) for frame in frames)
            ):
                raise InputError(
                    f"{path}: has no frames; export it again with ns-process-data or the like"
                )
            said = [
                _factor(content, key, path, 0) ** power
                for key, power in _UNITS.items()
                if key in content
            ]
            unit = self.depth_scale or (said or [_MILLIMETRE])[0]
            units.add(unit)
            if unknown := sorted({key for part in (content, *frames) for key in part} - _KNOWN):
                say(f"{path}: not read: {', '.join(map(in_one_line, unknown))}")
            for n, frame in enumerate(track(frames, "image sizes")):
                photograph, mask = _photograph(files, path, content, frame, unit)
                found.append((f"{path}: frame {n}", photograph))
                masks += [] if mask is None else [mask]
        check_images((place, one.name, one.fault) for place, one in found)
        photographs = [one for _, one in found]
        with_depth = any(photograph.depth is not None for photograph in photographs)
        more = (sorted(units), [fingerprint(mask) for mask in masks]) if with_depth else ()
        yield scene_of(root.resolve().name, photographs, self.image_scale, self.encoding, *more)

    def _files(self, root: Path) -> list[Path]:
        if self.transforms:
            return [regular(root / self.transforms, "correct or drop dataset.transforms=...")]
        for names in _USUAL:
            there = [root / name for name in names if (root / name).is_file()]
            if there:
                return there
        raise MissingFileError(
            "no such file",
            root / "transforms.json",
            "put it there or set dataset.transforms=FILE",
        )


@dataclass(frozen=True)
class _Files:
    """Finds the files that a frame names."""

    root: Path

    @cached_property
    def _below(self) -> ImageFolder:
        return ImageFolder(self.root, (*SUFFIXES, *DEPTH_SUFFIXES))

    def find(self, path: Path, frame: _Frame, key: str) -> tuple[str, str]:
        """Return the file, relative to root, that a key of the file `path` names, and why it cannot be used, or ""."""
        named = frame.get(key)
        if not isinstance(named, str) or not inner_path(named) or "\0" in named:
            raise InputError(f"{path}: a frame has no usable {key}; export it again")
        relative = inside(self.root, path.parent, named)
        name = inner_path(named) if relative is None else relative.as_posix()
        for suffix in ("", *SUFFIXES) if key == "file_path" else ("",):
            if relative is not None and (self.root / f"{name}{suffix}").is_file():
                return f"{name}{suffix}", ""

        def end(
            file: str,
        ) -> list[str]:  # an image may have been converted, a depth map or a mask may not
            path = PurePosixPath(file.lower())
            return [
                path.parent.name,
                without_suffix(path.name) if key == "file_path" else path.name,
            ]

        there = [file for file in self._below.find(name) if end(file) == end(name)]
        if len(there) == 1:
            return there[0], ""
        fault = f"{there[1]} is there as well; keep one of them" if there else "no such file"
        return name, f"{self.root / name}: {fault}, {path.name} names it; put it there"


def _photograph(
    files: _Files, path: Path, common: _Frame, frame: _Frame, unit: float
) -> tuple[Photograph, Path | None]:
    """Return what a frame describes, and the file of its mask."""
    root = files.root
    name, fault = files.find(path, frame, "file_path")
    place = f"{path}: {name}"
    lens = _lens({**common, **frame}, root / name, path, place)
    depth: Found = None
    mask = None
    if key := next((key for key in _DEPTHS if frame.get(key)), ""):
        file, no_depth = files.find(path, frame, key)
        depth = no_depth or root / file
        if not depth_suffix(file):
            depth = f"{root / file}: is no depth map of a known kind; write 16-bit .png, .npy or .tif"
        if frame.get("mask_path"):
            mask = root / files.find(path, frame, "mask_path")[0]
    try:
        pose = np.vstack(
            [np.array(frame.get("transform_matrix"), dtype=np.float64)[:3], [0, 0, 0, 1]]
        )
    except (TypeError, ValueError, IndexError):
        pose = np.zeros((4, 4))
    if pose.shape != (4, 4) or not is_rigid(pose):
        raise InputError(
            f"{place}: its transform_matrix is no camera's pose (4x4, rigid); export it again"
        )
    pose[:3, 3] /= _factor(common, "applied_scale", path, 1.0)
    return Photograph(
        name,
        root / name,
        lens,
        np.linalg.inv(pose @ np.diag([1.0, -1.0, -1.0, 1.0])),
        depth,
        partial(read_depth, unit=unit) if mask is None else partial(_masked, unit, mask),
        lens if lens.coefficients or lens.model == "fisheye" else None,
        fault=fault,
    ), mask


def _number(
    content: _Frame, key: str, place: object, default: float | None = None
) -> float | None:
    value = content.get(key, default)
    if value is None:
        return None
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float)
        or not math.isfinite(value)
    ):
        raise InputError(f"{place}: {key} is {value!r}, not a number; export it again")
    return float(value)


def _factor(content: _Frame, key: str, path: Path, default: float) -> float:
    factor = _number(content, key, path)
    if factor is not None and factor <= 0:
        raise InputError(f"{path}: {key} is {factor:g}, which is not above 0; export it again")
    return default if factor is None else factor


def _lens(frame: _Frame, image: Path, path: Path, place: str) -> Lens:
    """The lens of a frame: its own values, or those of the whole file; where sizes are left out, the image's."""
    model = str(frame.get("camera_model", "OPENCV"))
    if model not in _PERSPECTIVE + _FISHEYE or frame.get("is_fisheye"):
        raise InputError(
            f"{place}: camera_model {model} is not usable here; undistort the images to OPENCV or PINHOLE"
        )
    width, height, fl_x, fl_y, cx, cy = (
        _number(frame, key, place) for key in ("w", "h", "fl_x", "fl_y", "cx", "cy")
    )
    k = [_number(frame, f"k{i}", place, 0.0) or 0.0 for i in (1, 2, 3, 4)]
    p = [_number(frame, f"p{i}", place, 0.0) or 0.0 for i in (1, 2)]
    if width is None or height is None:
        size = image_size(image)
        if size is None:
            raise InputError(
                "has no w and h, and its image cannot be read", place, "give both, or the image"
            )
        width, height = size
    fl_x, fl_y = fl_x or _number(frame, "fx", place), fl_y or _number(frame, "fy", place)
    fl_x = fl_x or _focal(frame, "camera_angle_x", width, place)
    fl_y = fl_y or _focal(frame, "camera_angle_y", height, place) or fl_x
    fl_x = fl_x or fl_y
    if fl_x is None or fl_y is None or min(fl_x, fl_y, width, height) <= 0:
        raise InputError(
            f"{place}: has no usable fl_x, w and h, nor camera_angle_x; add them to {path.name}"
        )
    cx, cy = width / 2 if cx is None else cx, height / 2 if cy is None else cy
    camera = Camera(intrinsics(fl_x, fl_y, cx, cy), round(width), round(height))
    if model in _FISHEYE:
        return lens_of(camera, "fisheye", tuple(k), ())
    return lens_of(camera, "perspective", tuple(k), tuple(p))


def _focal(frame: _Frame, key: str, side: float, place: str) -> float | None:
    """The focal length, in pixels, of a field of view in radians."""
    angle = _number(frame, key, place)
    return side / 2 / math.tan(angle / 2) if angle is not None and 0 < angle < math.pi else None


def _masked(unit: float, mask: Path, path: Path) -> Array:
    import cv2

    metres, keep = (
        read_depth(path, unit),
        decode(mask, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION),
    )
    keep = np.asarray(
        cv2.resize(keep, metres.shape[::-1], interpolation=cv2.INTER_NEAREST_EXACT)
    )
    return np.where(keep > 0, metres, 0)
