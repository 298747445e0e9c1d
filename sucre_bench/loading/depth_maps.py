"""Finds and reads depth maps: planar depth along the optical axis, in metres, 0 where unknown.

The map of image ``sub/a.jpg`` is ``sub/a.jpg``, ``sub/depth_a``, ``sub/deptha`` or ``sub/a`` in the depth folder, or
else one of these names at its top, with a suffix of `_READERS`. Whole numbers are millimetres, floats metres. 65535 of
16 bits, and a largest value that repeats far beyond all others, mean "unknown". A map that could belong to two images
is used for neither.
"""

import importlib
import re
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path, PurePosixPath

import numpy as np

from sucre_bench.arrays import Array, Size
from sucre_bench.errors import InputError
from sucre_bench.imaging.image_files import (
    check_pixels,
    decode,
    read_array,
    read_tiff,
    same_shape,
    say_once_a_folder,
)
from sucre_bench.loading.find_folders import only, walk
from sucre_bench.machine.files import reading, regular

_FARTHEST_M = 1000.0
_NONE = 65535  # of 16 bits
# share of the pixels, and factor above the next value, of one that means "unknown"
_REPEATS = 0.001
_BEYOND = 8.0
# of COLMAP: of two maps of an image the first is taken
_FILTERED = ".geometric.bin"
_RAW = ".photometric.bin"


def find_depths(folder: Path, names: Sequence[str]) -> dict[str, Path | str]:
    """Return the depth map of each image that has one, or what is wrong where it is ambiguous.

    names: of the images, relative to the image folder. The folder may be missing. Raises InputError if it holds maps,
    but none of these images.
    """
    there = defaultdict[str, list[str]](list)  # files, by path without suffix
    for place, _, files in walk(folder):
        for file in files:
            path = (place / file).relative_to(folder).as_posix()
            if suffix := depth_suffix(file):
                there[path[: -len(suffix)]].append(path)
    # the file -> who may own it, how closely named
    claims: dict[str, list[tuple[int, str]]] = defaultdict(list)
    nearest: dict[str, str] = {}
    for name in names if there else ():
        image = PurePosixPath(name)
        places = dict.fromkeys(
            ("" if (parent := str(image.parent)) == "." else f"{parent}/", "")
        )
        # the closest name first
        stems = (
            image.name,
            f"depth_{image.stem}",
            f"depth{image.stem}",
            image.stem,
        )
        for rank, stem in enumerate(place + stem for place in places for stem in stems):
            if stem in there:
                claims[stem].append((rank, name))
                nearest.setdefault(name, stem)
    if there and not claims:
        example = f"depth_{PurePosixPath(names[0]).stem}.png"
        raise InputError(
            "no depth map is named after an image", folder, f"name them like {example}"
        )

    found: dict[str, Path | str] = {}
    for name, stem in nearest.items():
        closest = min(claims[stem])[0]
        owners = sorted(owner for rank, owner in claims[stem] if rank == closest)
        raw = {file.replace(_FILTERED, _RAW) for file in there[stem] if _FILTERED in file}
        maps = [folder / file for file in sorted({*there[stem]} - raw)]
        if name not in owners:
            continue  # it is the map of another image
        if len(owners) > 1:
            fault = f"may belong to {owners[0]} or {owners[1]}"
            found[name] = (
                f"{maps[0]}: {fault}; put depth maps into sub-folders as the images are"
            )
        elif one := only(maps):
            found[name] = one
    return found


def depth_suffix(name: str) -> str:
    """Return the suffix by which a file's name is taken for a depth map's, as it is written; empty if there is none."""
    return next(
        (name[-len(suffix) :] for suffix in _READERS if name.lower().endswith(suffix)), ""
    )


def read_depth(path: Path, unit: float | None = None) -> Array:
    """Return the depth map in a file, (H, W) float32 in metres. Raises InputError if it cannot be read.

    unit: metres in a unit of the stored values, whose kind then does not count.
    """
    values = stored_map(path)
    if values.dtype.itemsize == 1 or values.ndim != 2:
        raise _unusable(values, path)
    metres = values.astype(np.float32)
    if unit is not None:
        return np.asarray(metres * np.float32(unit))
    return metres if values.dtype.kind == "f" else np.asarray(metres / np.float32(1000))


def stored_map(path: Path) -> np.ndarray:
    """Return the values in a depth map's file, without axes of length one, 0 where they mean "unknown".

    Raises InputError if it cannot be read.
    """
    values = _READERS[depth_suffix(path.name).lower()](path)
    if values.dtype.kind not in "fiu":
        raise _unusable(values, path)
    values = np.squeeze(values) if values.ndim > 2 else values
    top = values.max(initial=0, where=np.isfinite(values))
    is_top = values == top
    below = values.max(initial=0, where=np.isfinite(values) & ~is_top)
    repeats = is_top.sum() > max(1, _REPEATS * values.size)
    if (values.dtype == np.uint16 and top == _NONE) or (repeats and top > _BEYOND * below > 0):
        say_once_a_folder(path, "depth", f"{top:g} in depth maps is taken for no depth")
        return np.where(is_top, 0, values).astype(values.dtype)
    return values


def _unusable(values: np.ndarray, path: Path) -> InputError:
    fault = f"is {values.dtype} of shape {'x'.join(map(str, values.shape))}"
    return InputError(fault, path, "expected float metres or 16-bit millimetres in one channel")


def read_numbers(path: Path) -> np.ndarray:
    """Return the array of an .npy, or that of an .npz called depth, or the only one. Raises as `read_array`."""

    def of_archive(names: list[str]) -> str:
        known = [
            name
            for name in ("depth", "disparity", "disp", "inverse_depth", "arr_0")
            if name in names
        ]
        if not known and len(names) != 1:
            raise ValueError(f"holds {', '.join(names)}, none called depth or disparity")
        return (known or names)[0]

    return read_array(path, of_archive if path.suffix.lower() == ".npz" else None)


def fitted(metres: Array, size: Size, path: Path) -> Array:
    """Return a depth map (H, W) float32 in metres, 0 = unknown, at `size` (width, height) by the nearest value.

    path: for messages. Raises InputError if the map is empty, negative or farther than 1 km, or if its shape is not the
    image's.
    """
    import cv2

    depth = np.where(np.isfinite(metres), metres, 0).astype(np.float32)
    if (depth < 0).any():
        raise InputError(
            f"depth {depth.min():g} m is negative", path, "write 0 where there is no depth"
        )
    farthest = depth.max(initial=0)
    if farthest == 0:
        raise InputError("no pixel has a depth", path, "make the map again, or remove it")
    if farthest > _FARTHEST_M:
        raise InputError(
            f"depth up to {farthest:.0f} m, it looks like millimetres", path, "divide by 1000"
        )
    height, width = depth.shape
    if (width, height) == size:
        return depth
    if not same_shape((width, height), size):
        fault = f"is {width}x{height}, a size that cannot match its image's {size[0]}x{size[1]}"
        raise InputError(fault, path, "make it from the undistorted image")
    return np.asarray(cv2.resize(depth, size, interpolation=cv2.INTER_NEAREST_EXACT))


def _read_picture(path: Path) -> np.ndarray:
    import cv2

    return decode(path, cv2.IMREAD_UNCHANGED)


def _read_colmap(path: Path) -> np.ndarray:
    """Read a dense map of COLMAP: "width&height&channels&", and float32 values by rows, one channel after the other."""
    with reading(path, "copy it again"):
        *sides, content = regular(path).read_bytes().split(b"&", 3)
        width, height, channels = map(int, sides)
        check_pixels(path, (height, width), channels)
        return np.frombuffer(content, "<f4").reshape(channels, height, width)


def _read_pfm(path: Path) -> np.ndarray:
    """Read a PFM of one channel: "Pf", width, height and scale, then rows from the bottom.

    The scale's sign is the order of bytes. Its size is not applied: stereo programs store depth as it is.
    """
    with reading(path, "copy it again"):
        content = regular(path).read_bytes()
        header = re.match(rb"Pf\s+(\d+)\s+(\d+)\s+(\S+)\s", content)
        if header is None:
            raise ValueError("its header")
        width, height = int(header[1]), int(header[2])
        order = "<f4" if float(header[3]) < 0 else ">f4"
        check_pixels(path, (height, width), channels=1)
        rows = np.frombuffer(content[header.end() :], order).reshape(height, width)
        return rows[::-1].astype(np.float32)


def _read_tiff(path: Path) -> np.ndarray:
    with reading(path, "copy it again"):
        try:
            return read_tiff(path)
        except Exception as fault:
            if "imagecodecs" not in str(fault):
                raise
            return _read_picture(path)  # a compression for which tifffile needs another package


# channels that programs store depth in, the likeliest first
_DEPTH = (
    "Z",
    "V",
    "Y",
    "depth",
    "R",
)


def _read_exr(path: Path) -> Array:
    """Return the depth map in a file, (H, W) float32: its only channel, or Z, V, Y, depth or R.

    Raises InputError if it cannot be read, has no such channel, or the package is not installed.
    """
    try:
        exr = importlib.import_module("OpenEXR")
    except ImportError as fault:
        raise InputError(
            "OpenEXR files need a package of their own", path, "pip install OpenEXR"
        ) from fault
    with reading(path, "copy it again"):
        with exr.File(str(regular(path)), separate_channels=True, header_only=True) as file:
            least, most = np.array(file.header()["dataWindow"], dtype=np.int64)
        if not (most >= least).all():
            raise ValueError("its size")
        check_pixels(path, (most - least + 1).tolist(), channels=4)
        with exr.File(str(path), separate_channels=True) as file:
            channels = {
                name: np.array(channel.pixels) for name, channel in file.channels().items()
            }
    name = (
        next(iter(channels))
        if len(channels) == 1
        else next((name for name in _DEPTH if name in channels), None)
    )
    if name is None or channels[name].ndim != 2 or channels[name].dtype.kind != "f":
        raise InputError(
            f"has channels {', '.join(channels)}", path, "write float depth into one channel, Z"
        )
    return np.asarray(channels[name], dtype=np.float32)


# OpenEXR needs a package of its own: OpenCV's wheels, tifffile, Pillow and imageio do not read it.
_READERS: Mapping[str, Callable[[Path], np.ndarray]] = {
    ".png": _read_picture,
    ".pfm": _read_pfm,
    **dict.fromkeys((".tif", ".tiff"), _read_tiff),
    **dict.fromkeys((".npy", ".npz"), read_numbers),
    **dict.fromkeys((_FILTERED, _RAW), _read_colmap),
    ".exr": _read_exr,
}
DEPTH_SUFFIXES = tuple(_READERS)
