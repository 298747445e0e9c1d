"""Reads camera raw files as linear images: the sensor's values, demosaiced and otherwise unchanged.

No white balance, no colour matrix, no tone curve, no brightening; black subtracted, white level to 1; each channel
interpolated on its own (bilinear). The maximum is the camera's, not each photograph's, so that views stay comparable.
The colours are the camera's own RGB.
"""

import importlib
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError
from sucre_bench.imaging.image_files import same_shape

RAW_SUFFIXES = (".arw", ".nef", ".dng")


def raw_size(path: Path) -> tuple[int, int] | None:
    """Return (width, height) of the developed image; None where the file is damaged, which decoding will explain."""
    rawpy = _rawpy(path)
    try:
        with rawpy.imread(str(path)) as raw:
            return raw.sizes.width, raw.sizes.height
    except (rawpy.LibRawError, OSError):
        return None


def read_raw(path: Path, size: tuple[int, int] | None = None) -> Array:
    """Return the developed image (H, W, 3) float32 in [0, 1], shrunk to `size` (width, height) by area if one is given.

    Raises InputError for a file that cannot be read, or where rawpy is not installed.
    """
    import cv2

    rawpy = _rawpy(path)
    try:
        with rawpy.imread(str(path)) as raw:
            counts = raw.postprocess(
                demosaic_algorithm=rawpy.DemosaicAlgorithm.LINEAR,
                output_color=rawpy.ColorSpace.raw,
                user_wb=[1.0, 1.0, 1.0, 1.0],
                gamma=(1, 1),
                no_auto_bright=True,
                adjust_maximum_thr=0.0,
                output_bps=16,
                user_flip=0,
            )
    except (rawpy.LibRawError, OSError) as fault:
        raise InputError(f"{path}: cannot be read ({fault}); copy it again") from fault
    image = counts.astype(np.float32) / np.float32(65535)
    height, width = image.shape[:2]
    if size is not None and (width, height) != size:
        if not same_shape((width, height), size):
            raise InputError(f"{path}: is {width}x{height}, expected {size[0]}x{size[1]}; use the file as released")
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return np.asarray(image)


def _rawpy(path: Path) -> Any:
    try:
        return importlib.import_module("rawpy")
    except ImportError as fault:
        raise InputError(f"{path}: is a raw file; install rawpy (pip install rawpy), or use linearPNG") from fault
