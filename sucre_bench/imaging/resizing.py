"""Scores of pictures that are first resized, cropped or converted, as the programs of many papers do.

A variant's name says so behind an @: "funie@256" is the variant funie of the pictures at 256x256 pixels, and
"unmasked@256@crop4" leaves out four pixels at each edge of these.
"""

import re
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from sucre_bench.arrays import AnyArray, Array, Size, locked, once
from sucre_bench.errors import InputError, unknown_name
from sucre_bench.imaging.encoding import converted, to_8bit
from sucre_bench.scene import Encoding, Pixels, Plane, Restoration, View

Filter = Literal["bicubic", "bilinear", "nearest"]
Change = Literal["y", "range2", "minmax"]


@dataclass(frozen=True, slots=True)
class Resizing:
    """The square that pictures are resized to."""

    side: int
    """In pixels."""

    by: Filter = "bicubic"
    """See `resized`."""


@dataclass(frozen=True, slots=True)
class Form:
    """Changes of the pictures before they are scored, in this order."""

    resizing: Resizing | None = None

    crop: int = 0
    """Pixels that are left out at each edge."""

    change: Change | None = None
    """What takes the place of the colours. "y": Y of YCbCr, 16 to 235 of 255; "range2": half of the values, as if white
    were 2; "minmax": the restored picture, less its least value, over its range, as torchvision's normalize."""


def split_variant(variant: str) -> tuple[str, Form | None]:
    """Read "funie", or "funie@256-bilinear@crop4@y" with some of these. InputError for anything else."""
    name, *words = variant.split("@")
    form = Form()
    for word in words:
        sized, cropped = (
            re.fullmatch(r"([1-9]\d{0,4})(?:-(\w+))?", word),
            re.fullmatch(r"crop([1-9]\d?)", word),
        )
        if sized:
            by = next((by for by in get_args(Filter) if by == (sized[2] or "bicubic")), None)
            if by is None:
                raise unknown_name(f"variant '{variant}'", sized[2], get_args(Filter), "filter")
            form = replace(form, resizing=Resizing(int(sized[1]), by))
        elif cropped:
            form = replace(form, crop=int(cropped[1]))
        elif change := next((change for change in get_args(Change) if change == word), None):
            form = replace(form, change=change)
        else:
            raise InputError(
                f"variant '{variant}': @ needs a side in pixels; write {name}@256 or {name}@256-bilinear"
            )
    return name, form if words else None


@once  # several forms share a size
def resized(image: AnyArray, resizing: Resizing) -> AnyArray:
    """Return an image (H, W, 3), uint8 or float32, as (side, side, 3) of the same type, whatever its shape was.

    "bicubic": Pillow's, which averages where it shrinks; "bilinear": OpenCV's, which does not; "nearest": Pillow's, the
    default of its `resize` before version 7 of 2020.
    """
    size = (resizing.side, resizing.side)
    if resizing.by == "bilinear":
        import cv2

        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR))
    return resized_by_pillow(image, size, resizing.by)


def resized_by_pillow(
    image: AnyArray, size: Size, by: Literal["bicubic", "nearest"]
) -> AnyArray:
    """Return an image (H, W, C), uint8 or float32, at a size (width, height), each channel by itself."""
    from PIL import Image

    how = Image.Resampling.BICUBIC if by == "bicubic" else Image.Resampling.NEAREST
    planes = (
        Image.fromarray(np.ascontiguousarray(image[..., c])) for c in range(image.shape[-1])
    )
    return np.stack([np.asarray(plane.resize(size, how)) for plane in planes], axis=-1)


def changed_restoration(restored: Restoration, encoding: Encoding, form: Form) -> Restoration:
    """Return a restoration in a form, gamma-encoded, changed in float; pixels without a colour count as black.

    encoding: of its image.
    """
    image = converted(restored.image, encoding, "gamma").astype(np.float32, copy=False)
    image = image if np.isfinite(image.sum()) else np.nan_to_num(image, nan=0.0)
    return replace(restored, image=locked(_changed(image, form)), confidence=None)


def changed_picture(shown: Array, view: View, form: Form) -> tuple[Array, View]:
    """Return the picture shown and its view in a form, gamma-encoded and without depth.

    The picture, the view's image and its reference are resized in 8 bits, as files hold them. Pixels without a colour
    count as black.
    """
    picture = _in_8_bits(shown, form)
    picture.setflags(write=False)
    of_view = replace(form, change=None) if form.change == "minmax" else form
    return picture, View(view.name, _Changed(view.pixels, view.encoding, of_view))


@dataclass(frozen=True, eq=False)
class _Changed:
    """The planes of a view in a form."""

    pixels: Pixels
    encoding: Encoding
    form: Form

    def load(self, plane: Plane) -> Array | None:
        values = None if plane == "depth" else self.pixels.load(plane)
        if values is None:
            return None
        return _in_8_bits(converted(values, self.encoding, "gamma"), self.form)


def _in_8_bits(image: Array, form: Form) -> Array:
    levels = resized(_levels(image), form.resizing) if form.resizing else _levels(image)
    return _changed(levels.astype(np.float32) / np.float32(255), replace(form, resizing=None))


@once
def _levels(image: Array) -> AnyArray:
    return locked(to_8bit(image))


def _changed(image: Array, form: Form) -> Array:
    image = resized(image, form.resizing) if form.resizing else image
    if form.crop:
        if min(image.shape[:2]) <= 2 * form.crop:
            raise InputError(
                f"crop{form.crop} leaves nothing of a picture of {image.shape[1]}x{image.shape[0]}"
            )
        image = image[form.crop : -form.crop, form.crop : -form.crop]
    if form.change == "y":  # ITU-R BT.601, as MATLAB's rgb2ycbcr
        luma = (16 + image @ np.array([65.481, 128.553, 24.966], np.float32)) / np.float32(255)
        return np.repeat(luma[..., None], 3, axis=-1)
    if form.change == "range2":
        return image / 2
    if form.change == "minmax":
        return (image - image.min()) / max(float(np.ptp(image)), 1e-5)
    return image
