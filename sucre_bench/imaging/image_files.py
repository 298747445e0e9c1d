"""Reads image files: 8- or 16-bit PNG, TIFF or JPEG to RGB in [0, 1].

The pixels are taken as they lie in the file, as COLMAP does: an orientation noted in EXIF is ignored.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError
from sucre_bench.machine.files import write_atomically

__all__ = [
    "SUFFIXES",
    "decode",
    "decode_bytes",
    "encode_png",
    "image_size",
    "read_rgb",
    "same_shape",
    "write_image",
    "write_png",
]

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")  # of what is taken for an image in a folder


def image_size(path: Path) -> tuple[int, int] | None:
    """Return (width, height) from the file's header; None where that cannot be read, which decoding will explain."""
    import tifffile
    from PIL import Image

    try:
        if path.suffix.lower() in (".tif", ".tiff"):  # Pillow does not know 16-bit colour there
            with tifffile.TiffFile(path) as file:
                return file.pages.first.imagewidth, file.pages.first.imagelength
        with Image.open(path) as image:
            return image.size
    except (OSError, ValueError, SyntaxError, tifffile.TiffFileError, Image.DecompressionBombError):
        return None


def same_shape(one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether two sizes (width, height) differ by scale only: to 1 % of the aspect ratio, or to a pixel's rounding."""
    (width, height), (wide, high) = sorted((one, other))
    return abs(high * width / wide - height) <= max(1.0, 0.01 * height)


def read_rgb(path: Path, size: tuple[int, int] | None = None) -> Array:
    """Return an image (H, W, 3) float32 RGB in [0, 1], shrunk to `size` (width, height) by area if one is given.

    Gray is repeated over the channels, transparency dropped. Raises InputError when the file cannot be read, is neither
    8- nor 16-bit, or its size is not one that shrinks to `size`.
    """
    import cv2

    stored = decode(path, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION)
    if stored.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: is {stored.dtype}; save it with 8 or 16 bits a channel")
    image = stored[..., ::-1].astype(np.float32) / np.iinfo(stored.dtype).max
    height, width = image.shape[:2]
    if size is None or (width, height) == size:
        return image
    if width < size[0] or height < size[1] or not same_shape((width, height), size):
        raise InputError(f"{path}: is {width}x{height}, expected {size[0]}x{size[1]}; resize it or the others")
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def decode(path: Path, flags: int) -> np.ndarray:
    """Return what OpenCV makes of a file by its flags, channels in BGR order; a JPEG always has 8 bits, and three
    channels unless gray is asked for. InputError when it is unreadable or incomplete.
    """
    try:
        data = path.read_bytes()
    except OSError as fault:
        raise InputError(f"{path}: cannot be read, {fault.strerror or fault}; copy the file again") from fault
    return decode_bytes(data, flags, str(path))


def decode_bytes(data: bytes, flags: int, place: str) -> np.ndarray:
    """Return what `decode` does, of a file's content. place: the file's name, for errors."""
    import cv2
    from PIL import Image

    if data.startswith(b"\xff\xd8"):  # OpenCV may fill up a cut JPEG with gray, Pillow does not
        try:
            with Image.open(io.BytesIO(data)) as image:
                if not flags & cv2.IMREAD_COLOR:  # a bit that is set in IMREAD_UNCHANGED, too
                    return np.asarray(image.convert("L"))
                return np.asarray(image.convert("RGB"))[..., ::-1]
        except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as fault:
            reason = fault.strerror if isinstance(fault, OSError) and fault.strerror else fault
            raise InputError(f"{place}: cannot be read, {reason}; copy the file again") from fault
    complete = not data.startswith(b"\x89PNG") or b"IEND" in data[-4096:]
    decoded = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags) if data and complete else None
    if decoded is None:
        raise InputError(
            f"{place}: cannot be read, {'damaged or not an image' if complete else 'cut short'}; copy it again"
        )
    return np.asarray(decoded)


def encode_png(values: npt.NDArray[Any], compression: int = 3) -> bytes:
    """Return gray, BGR or BGRA values, 8 or 16 bit, as a PNG file. compression: 0 (fast) to 9 (small)."""
    import cv2

    return bytes(cv2.imencode(".png", values, [cv2.IMWRITE_PNG_COMPRESSION, compression])[1])


def write_png(path: Path, values: npt.NDArray[Any], compression: int = 3) -> None:
    """Write gray, BGR or BGRA values, 8 or 16 bit. compression: 0 (fast) to 9 (small).

    Raises OutputError if the file cannot be written.
    """
    write_atomically(path, encode_png(values, compression))


def write_image(path: Path, values: npt.NDArray[Any]) -> None:
    """Write gray or BGR values, 8 bit, in the format of the path's suffix, see `SUFFIXES`."""
    import cv2

    write_atomically(path, bytes(cv2.imencode(path.suffix, values)[1]))
