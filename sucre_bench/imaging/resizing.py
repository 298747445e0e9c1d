"""Scores of pictures that are first resized to a square, as the programs of many papers do.

A variant's name says so behind an @: "funie@256" is the variant funie of the pictures at 256x256 pixels.
"""

import re
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError, unknown_name
from sucre_bench.imaging.encoding import converted, to_8bit
from sucre_bench.scene import Encoding, Pixels, Plane, Restoration, View

Filter = Literal["bicubic", "bilinear", "nearest"]


@dataclass(frozen=True, slots=True)
class Resizing:
    """side: of the square, pixels; by: see `resized`."""

    side: int
    by: Filter = "bicubic"


def split_variant(variant: str) -> tuple[str, Resizing | None]:
    """Read "funie", "funie@256", "funie@256-bilinear" or "funie@256-nearest". InputError for anything else."""
    name, at, resizing = variant.partition("@")
    if not at:
        return name, None
    found = re.fullmatch(r"([1-9]\d{0,4})(?:-(\w+))?", resizing)
    if not found:
        raise InputError(f"variant '{variant}': @ needs a side in pixels; write {name}@256 or {name}@256-bilinear")
    filters: tuple[Filter, ...] = ("bicubic", "bilinear", "nearest")
    for by in filters:
        if by == (found[2] or "bicubic"):
            return name, Resizing(int(found[1]), by)
    raise unknown_name(f"variant '{variant}'", found[2], filters, "filter")


def resized(image: npt.NDArray[Any], resizing: Resizing) -> npt.NDArray[Any]:
    """Return an image (H, W, 3), uint8 or float32, as (side, side, 3) of the same type, whatever its shape was.

    "bicubic": Pillow's, which averages where it shrinks; "bilinear": OpenCV's, which does not; "nearest": Pillow's, the
    default of its `resize` before version 7 of 2020.
    """
    size = (resizing.side, resizing.side)
    if resizing.by == "bilinear":
        import cv2

        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR))
    from PIL import Image

    how = Image.Resampling.BICUBIC if resizing.by == "bicubic" else Image.Resampling.NEAREST
    planes = (Image.fromarray(np.ascontiguousarray(image[..., c])) for c in range(image.shape[-1]))
    return np.stack([np.asarray(plane.resize(size, how)) for plane in planes], axis=-1)


def resized_restoration(restored: Restoration, encoding: Encoding, resizing: Resizing) -> Restoration:
    """Return a restoration at another size, gamma-encoded, resized in float; pixels without a colour count as black.

    encoding: of its image.
    """
    image = np.nan_to_num(converted(restored.image, encoding, "gamma"), nan=0.0).astype(np.float32)
    return replace(restored, image=resized(image, resizing), confidence=None)


def resized_picture(shown: Array, view: View, resizing: Resizing) -> tuple[Array, View]:
    """Return the picture shown and its view at another size, gamma-encoded and without depth.

    The picture, the view's image and its reference are resized in 8 bits, as files hold them. Pixels without a colour
    count as black.
    """
    picture = _in_8_bits(shown, resizing)
    picture.setflags(write=False)
    return picture, View(view.name, _Resized(view.pixels, view.encoding, resizing))


@dataclass(frozen=True, eq=False)
class _Resized:
    """The planes of a view at another size."""

    pixels: Pixels
    encoding: Encoding
    resizing: Resizing

    def load(self, plane: Plane) -> Array | None:
        values = None if plane == "depth" else self.pixels.load(plane)
        if values is None:
            return None
        return _in_8_bits(converted(values, self.encoding, "gamma"), self.resizing)


def _in_8_bits(image: Array, resizing: Resizing) -> Array:
    return resized(to_8bit(image), resizing).astype(np.float32) / np.float32(255)
