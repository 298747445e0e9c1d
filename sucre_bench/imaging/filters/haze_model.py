"""Restoring by a veiling light and a transmission: I = J t + A (1 - t), so that J = (I - A) / t + A.

I: image, J: the scene without the water between it and the camera, A: veiling light, (3,), the colour of water so deep
that nothing is seen through it; t: transmission, the share of the scene's light that arrives (Schechner & Karpel 2005;
He, Sun & Tang 2011). Methods differ in how they find A and t; this is what is the same in several of them.
"""

from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.scene import Restoration, Water


def highest(plane: Array, share: float) -> Mask:
    """Return (H, W): the pixels that hold the highest `share` of values, at least one, and all that equal the last."""
    n = max(1, round(share * plane.size))
    least = np.partition(plane, plane.size - n, axis=None)[plane.size - n]
    return np.asarray(plane >= least)


def brightest(image: Array, among: Mask) -> Array:
    """Return (3,) float64: the colour of the brightest of some pixels (H, W), by R + G + B; of equals, the first."""
    colours = image[among].astype(np.float64)  # (P, 3): one index counts pixels, another channels
    return np.asarray(colours[colours.sum(axis=1).argmax()])


def stretched_plane(plane: Array) -> Array:
    """Return the plane (H, W) brought to [0, 1] by its minimum and maximum; 0 where it is the same everywhere."""
    low, high = plane.min(), plane.max()
    return np.asarray((plane - low) / max(high - low, np.float32(1e-6)))


def nearest_depth(image: Array, veiling_light: Array) -> float:
    """Return the depth of the nearest pixel, as a share of the deepest scene's: 1 - max |A - I| / max(A, 1 - A).

    The difference is greatest where the least water lies between; its channel's A says how great it can become.
    Peng & Cosman 2017; Song et al. 2018 take it over.
    """
    A = np.asarray(veiling_light, dtype=np.float64)
    difference = np.stack([np.abs(A[k] - [image[..., k].min(), image[..., k].max()]).max() for k in range(3)])
    k = int(difference.argmax())
    return float(1 - difference[k] / max(A[k], 1 - A[k]))


def reduced(image: Array, longest: int) -> Array:
    """Return the image with its longer side brought to `longest` pixels by averaging; itself where it is no larger.

    image: (H, W) or (H, W, 3) float32.
    """
    import cv2

    height, width = image.shape[:2]
    scale = longest / max(height, width)
    if scale >= 1:
        return image
    size = max(1, round(width * scale)), max(1, round(height * scale))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def recovered(image: Array, veiling_light: Array, transmission: Array) -> Array:
    """Return J = (I - A) / t + A, (H, W, 3) float32, not clipped; transmission: (H, W) or (H, W, 3), > 0."""
    A = np.asarray(veiling_light, dtype=np.float32)
    J = image - A
    J /= transmission if transmission.ndim == 3 else transmission[..., None]
    J += A
    return J


def restoration(image: Array, veiling_light: Array, transmission: Array, **info: Any) -> Restoration:
    """Return what a method gives that knows A and t: J, A, and how much light came through in each channel."""
    unknown = np.full(3, np.nan)
    return Restoration(
        recovered(image, veiling_light, transmission),
        Water(np.asarray(veiling_light, dtype=np.float64), unknown, unknown),
        info={**transmissions(transmission), **info},
    )


def transmissions(transmission: Array) -> dict[str, list[float]]:
    """Return the least, mean and greatest transmission of each channel, as lists; (H, W) counts as one channel."""
    planes = np.moveaxis(np.atleast_3d(transmission), -1, 0)
    return {
        "transmission_min": [float(plane.min()) for plane in planes],
        "transmission_mean": [float(plane.mean(dtype=np.float64)) for plane in planes],
        "transmission_max": [float(plane.max()) for plane in planes],
    }
