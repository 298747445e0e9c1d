"""Turns one of two pictures of a view to lie as the other does, where their EXIF orientations differ.

Some programs turn pictures by this tag (OpenCV), others do not (PyTorch's and Pillow's readers), and most drop it from
what they write. So where tags differ, the picture's content decides.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import ANY_FAULT
from sucre_bench.imaging.image_files import metadata_of, say_once_a_folder

_TAG = 274
_SIDE = 32  # pixels of the pictures that are compared
_BACK = {6: 8, 8: 6}  # what undoes an orientation, if not itself


def orientation_of(path: Path) -> int:
    """Return the EXIF orientation of a picture, 1 to 8; 1, upright, where it says none."""
    try:
        found = metadata_of(path)[0].get(_TAG, 1)
    except ANY_FAULT:  # decoding says what is wrong
        return 1
    return found if found in range(1, 9) else 1


def upright(image: Array, orientation: int) -> Array:
    """Return an image (H, W, 3) as viewers turn it."""
    image = image.swapaxes(0, 1) if orientation > 4 else image
    image = image[::-1] if orientation in (3, 4, 7, 8) else image
    return np.ascontiguousarray(image[:, ::-1] if orientation in (2, 3, 6, 7) else image)


def lying_as(image: Array, path: Path, other: Callable[[], Array], other_path: Path) -> Array:
    """Return an image (H, W, 3) of a file as it lies in another file of the same view.

    other: returns what the other file holds. A line says what was done where the files' orientations differ.
    """
    one, two = orientation_of(path), orientation_of(other_path)
    if one == two:
        return image
    turned, seen = upright(upright(image, one), _BACK.get(two, two)), other()
    is_turned = _nearness(turned, seen) > _nearness(image, seen)
    how = "upright" if is_turned else "as they are stored, for so they are alike"
    fault = f"{path.name} and {other_path.name} have different EXIF orientations"
    say_once_a_folder(path, "orientation", f"{fault}; such pairs are compared {how}")
    return turned if is_turned else image


def _nearness(one: Array, other: Array) -> tuple[bool, float]:
    """Whether two images have the same size or shape, and the correlation of their brightness."""
    import cv2

    is_alike = (one.shape[0] < one.shape[1]) == (other.shape[0] < other.shape[1])
    size = (_SIDE, _SIDE)
    small = [
        cv2.resize(np.nan_to_num(x).mean(axis=-1), size, interpolation=cv2.INTER_AREA).ravel()
        for x in (one, other)
    ]
    return is_alike, float(np.corrcoef(*small)[0, 1])
