"""The masks of restorations: which pixels have a colour.

A mask is a PNG of 1 bit a pixel, white where there is a colour. A restoration without holes has none.
"""

import hashlib
from pathlib import Path

import numpy as np

from sucre_bench.arrays import Mask
from sucre_bench.errors import MissingFileError
from sucre_bench.imaging.image_files import decode
from sucre_bench.machine.files import remove, write_atomically


def write_mask(path: Path, mask: Mask) -> None:
    """Write the mask (H, W) of a restoration; remove an older one if every pixel has a colour.

    Raises OutputError if the file cannot be written.
    """
    import cv2

    if mask.all():
        remove(path)
        return
    bits = cv2.imencode(".png", mask.astype(np.uint8) * 255, [cv2.IMWRITE_PNG_BILEVEL, 1])[1]
    write_atomically(path, bytes(bits))


def read_mask(path: Path) -> Mask:
    """Return a mask (H, W) that `write_mask` wrote. Raises MissingFileError or DamagedFileError."""
    import cv2

    if not path.is_file():
        raise MissingFileError("is gone", path, "run its method again with overwrite=always")
    return np.asarray(decode(path, cv2.IMREAD_GRAYSCALE) > 0)


def mask_id(mask: Mask) -> str:
    """Return a short hash of a mask, equal exactly for equal masks."""
    content = str(mask.shape).encode() + np.packbits(mask).tobytes()
    return hashlib.blake2b(content, digest_size=8).hexdigest()
