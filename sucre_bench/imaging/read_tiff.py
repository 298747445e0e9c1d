"""Reads TIFFs that OpenCV would change: it multiplies colours of 8 bits by alpha, and mixes planes of 16 bits."""

import io
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.errors import InputError
from sucre_bench.imaging.image_header import pillow, tiff_file

_ORIENTATION = 274
_PLANES = 2  # the value of PlanarConfiguration
_COLOURS = {1: 1, 2: 3}  # channels of gray (0 is black) and of RGB, by PhotometricInterpretation
_MOST_CHANNELS = 8
_MULTIPLIED, _STRAIGHT = 1, 2  # kinds of alpha, in ExtraSamples


@dataclass(frozen=True)
class Stored:
    """What a TIFF stores. bgr: (H, W, 3) of any type; alpha: (H, W) of the same type, None if there is none."""

    bgr: npt.NDArray[Any]
    alpha: npt.NDArray[Any] | None


def read_stored(data: bytes, place: str) -> Stored | None:
    """Return the colours of a TIFF as they are stored; None if it cannot be decoded, which its reader will explain.

    data: the file's content, with a header that could be read; place: its name, for errors. Raises InputError if it is
    of a form that no decoder reads as stored.
    """
    with tiff_file(io.BytesIO(data)) as file:
        page = file.pages.first
        stored = _by_tifffile(page)
        if stored is None:
            data = _not_turned(data, page, file.byteorder)
            stored = _by_pillow(data, page)
        return _by_opencv(data, page, place) if stored is None else _split(stored, page)


def _by_tifffile(page: Any) -> npt.NDArray[Any] | None:
    """(H, W, channels); None for a compression that tifffile needs another package for."""
    if page.samplesperpixel > _MOST_CHANNELS:  # a damaged header may say any number
        return None
    try:
        values = np.asarray(page.asarray())
    except Exception:  # each of its decoders has its own
        return None
    return _fitting(np.moveaxis(values, 0, -1) if page.planarconfig == _PLANES and values.ndim == 3 else values, page)


def _by_pillow(data: bytes, page: Any) -> npt.NDArray[Any] | None:
    """(H, W, channels); None for what Pillow changes: other than 8 bits, and colours stored multiplied by alpha."""
    if page.bitspersample != 8 or _MULTIPLIED in page.extrasamples:
        return None
    try:
        with pillow().open(io.BytesIO(data)) as image:
            return _fitting(np.asarray(image), page)
    except Exception:  # each of its decoders has its own
        return None


def _by_opencv(data: bytes, page: Any, place: str) -> Stored | None:
    """None if OpenCV cannot read it. InputError for what it changes."""
    import cv2

    values = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if values is None:
        return None
    bgr = values[..., :3] if values.ndim == 3 else np.repeat(values[..., None], 3, axis=2)
    alpha = values[..., 3] if values.shape[2:] == (4,) else None
    if page.bitspersample == 8 and _STRAIGHT in page.extrasamples and (alpha is None or alpha.min() < 255):
        raise InputError(
            "has transparency in a form that cannot be read", place, "save it without transparency, or as PNG"
        )
    if page.bitspersample != 8 and page.planarconfig == _PLANES:
        raise InputError("has planes that cannot be read", place, "copy it again, or save it as PNG")
    return Stored(bgr, alpha)


def _fitting(values: npt.NDArray[Any], page: Any) -> npt.NDArray[Any] | None:
    """The values if they are the page's channels, (H, W, channels); else None."""
    shape = (page.imagelength, page.imagewidth, page.samplesperpixel)
    return values if values.shape == shape and page.photometric in _COLOURS else None


def _split(values: npt.NDArray[Any], page: Any) -> Stored:
    n = _COLOURS[page.photometric]
    bgr = values[..., [2, 1, 0]] if n == 3 else np.repeat(values[..., :1], 3, axis=2)
    at = next((i for i, kind in enumerate(page.extrasamples, n) if kind in (_MULTIPLIED, _STRAIGHT)), None)
    return Stored(bgr, None if at is None else values[..., at])


def _not_turned(data: bytes, page: Any, byteorder: str) -> bytes:
    """The file with an orientation of 1: Pillow and OpenCV would turn the picture."""
    tag = page.tags.get(_ORIENTATION)
    if tag is None:
        return data
    n = tag.valuebytecount
    upright = (1).to_bytes(n, "little" if byteorder == "<" else "big")
    return data[: tag.valueoffset] + upright + data[tag.valueoffset + n :]
