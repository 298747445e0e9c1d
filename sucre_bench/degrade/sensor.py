"""Degrades images as a worse camera would: blur, fewer pixels, noise, fewer bits, JPEG.

Images are (H, W, 3) float32 in [0, 1], RGB.
"""

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.encoding import converted
from sucre_bench.scene import Encoding


def blurred(image: Array, sd_px: float, encoding: Encoding) -> Array:
    """Return an image blurred by a Gaussian in linear light, like a lens."""
    import cv2

    light: Array = np.asarray(cv2.GaussianBlur(converted(image, encoding, "linear"), (0, 0), sd_px), dtype=np.float32)
    return np.asarray(converted(light, "linear", encoding), dtype=np.float32)


def shrunk(plane: Array, scale: float) -> Array:
    """Return a plane (H, W, 3) or (H, W) in another size: colours by area, depths by the nearest value."""
    import cv2

    how = cv2.INTER_AREA if plane.ndim == 3 else cv2.INTER_NEAREST_EXACT
    size = [max(1, round(side * scale)) for side in plane.shape[1::-1]]
    return np.asarray(cv2.resize(plane, size, interpolation=how))


def noisy(image: Array, sd: float, rng: np.random.Generator) -> Array:
    """Return an image with Gaussian noise, independent in every pixel and channel, of stored intensities; clipped."""
    noise = rng.standard_normal(image.shape, dtype=np.float32)
    return np.asarray((image + np.float32(sd) * noise).clip(0, 1))


def quantised(image: Array, bits: int) -> Array:
    """Return an image whose stored intensities are rounded to 2^bits levels, 0 and 1 among them."""
    top = np.float32(2**bits - 1)
    return np.asarray(np.rint(image.clip(0, 1) * top) / top)


def through_jpeg(image: Array, quality: int, encoding: Encoding) -> Array:
    """Return an image after storage in an 8-bit JPEG file (libjpeg's quality, 4:2:0).

    JPEG files are gamma-encoded: a linear image is encoded and decoded again.
    """
    import cv2

    picture = np.rint(converted(image, encoding, "gamma").clip(0, 1) * 255).astype(np.uint8)
    written, file = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert written
    read = cv2.imdecode(file, cv2.IMREAD_COLOR)
    assert read is not None
    return np.asarray(converted(read[..., ::-1] / np.float32(255), "gamma", encoding), dtype=np.float32)
