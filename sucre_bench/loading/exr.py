"""Reads depth maps in OpenEXR files, through the optional package OpenEXR (BSD-3-Clause; wheels for every platform).

OpenCV's wheels are built without OpenEXR, and tifffile, Pillow and imageio do not read it.
"""

import importlib
from pathlib import Path

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import DamagedFileError, InputError, file_error
from sucre_bench.imaging.image_files import check_pixels
from sucre_bench.machine.files import regular

_DEPTH = ("Z", "V", "Y", "depth", "R")  # channels that programs store depth in, the likeliest first


def read_exr(path: Path) -> Array:
    """Return the depth map in a file, (H, W) float32: its only channel, or Z, V, Y, depth or R.

    Raises InputError if it cannot be read, has no such channel, or the package is not installed.
    """
    try:
        exr = importlib.import_module("OpenEXR")
    except ImportError as fault:
        raise InputError("OpenEXR files need a package of their own", path, "pip install OpenEXR") from fault
    try:
        with exr.File(str(regular(path)), separate_channels=True, header_only=True) as file:
            least, most = np.array(file.header()["dataWindow"], dtype=np.int64)
        if not (most >= least).all():
            raise ValueError("its size")
        check_pixels(path, (most - least + 1).tolist(), channels=4)
        with exr.File(str(path), separate_channels=True) as file:
            channels = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    except InputError:
        raise
    except OSError as fault:
        raise file_error(path, fault, "copy the file again") from fault
    except Exception as fault:  # the decoder raises errors of many kinds
        raise DamagedFileError("cannot be read, cut short or not an OpenEXR file", path, "copy it again") from fault
    name = next(iter(channels)) if len(channels) == 1 else next((name for name in _DEPTH if name in channels), None)
    if name is None or channels[name].ndim != 2 or channels[name].dtype.kind != "f":
        raise InputError(f"has channels {', '.join(channels)}", path, "write float depth into one channel, Z")
    return np.asarray(channels[name], dtype=np.float32)
