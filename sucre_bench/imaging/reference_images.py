"""The reference that a picture is compared with."""

import math

from sucre_bench.arrays import Array, Mask, coloured_pixels
from sucre_bench.errors import InputError
from sucre_bench.scene import View


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
