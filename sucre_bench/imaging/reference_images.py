"""The reference that a picture is compared with."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from sucre_bench.arrays import Array, Mask, coloured_pixels
from sucre_bench.errors import InputError
from sucre_bench.imaging.image_files import say_once_a_folder
from sucre_bench.scene import View

_BLOCK = 0.01  # of a picture; of 60 pictures of four published methods, 2 have a clipped shadow as large
_DARK = 4 / 255
_LEAVE_OUT = "leave it out if its reference has holes"
# of the outlines that are compared
_SIDE = 48
_BLUR_PX = 4.0
# Of 15 methods' right pictures, those of other views were less alike by .09 at least; of wrong ones, more by .09.
NEARER = 0.05


def reference_of(view: View, image: Array) -> Array:
    """Return a view's reference (H, W, 3), which it must have. Raises InputError if an image has another size."""
    reference = view.reference
    assert reference is not None
    if reference.shape != image.shape:
        (h, w), (rh, rw) = image.shape[:2], reference.shape[:2]
        raise InputError(
            f"{view.name}: the reference is {rw}x{rh}, the image {w}x{h}; give both in one size"
        )
    return reference


def known_in_both(image: Array, reference: Array, view: View) -> Mask:
    """Return the pixels (H, W) with a colour in an image and in its reference, and with depth if the view has any."""
    mask = coloured_pixels(image) & coloured_pixels(reference)
    mask &= view.valid
    return mask


def psnr_of(squared_error: float) -> float:
    """Return the PSNR, in dB, of a mean squared error of pictures in [0, 1]; infinite for equal pictures."""
    return -10 * math.log10(squared_error) if squared_error else math.inf


def say_if_black(
    path: Path, image: Array, other: Callable[[], Array], remedy: str = _LEAVE_OUT
) -> None:
    """Say that a picture has exactly black pixels in one block where another one has light, which may be holes.

    path: of the picture; image: (H, W, 3), where NaN is no colour; other: returns the other one; remedy: if these are
    holes.
    """
    import cv2

    is_black = (image == 0).all(axis=-1)
    if is_black.mean() < _BLOCK:
        return
    _, labels, sizes, _ = cv2.connectedComponentsWithStats(is_black.astype(np.uint8))
    block = labels == 1 + int(sizes[1:, cv2.CC_STAT_AREA].argmax())
    if block.mean() < _BLOCK:
        return
    lit = other()
    if lit.shape[:2] == block.shape and np.median(lit[block].max(axis=-1)) > _DARK:
        share = f"{100 * block.mean():.0f} % of {path.name}"
        say_once_a_folder(
            path,
            "black",
            f"{share} is exactly black in one block, and scored as a colour; {remedy}",
        )


def outline(image: Array) -> Array:
    """Return the edges of an image as a vector of length 1: what water and a restoration leave as it is.

    The product of two outlines says how alike images are; see `NEARER`.
    """
    import cv2

    gray = cv2.resize(
        np.nan_to_num(image).mean(axis=-1), (_SIDE, _SIDE), interpolation=cv2.INTER_AREA
    )
    edges = (gray - cv2.GaussianBlur(gray, (0, 0), _BLUR_PX)).ravel()
    return np.asarray(edges / max(float(np.linalg.norm(edges)), 1e-6))
