"""Finds open water in an image: an area without texture, the veiling light there, and similar pixels.

After Berman et al. 2021, who find edges by a trained detector; here a gradient is one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.imaging.filters import window_max

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)  # ITU-R BT.709
_QUANTISATION = 1e-5  # variance added to each channel's, about that of 8 bits: a flat area has none of its own


def textureless_area(encoded: Array, share: float) -> Mask:
    """Return (H, W): the largest connected region among the `share` of pixels that are farthest from any edge.

    encoded: (H, W, 3) gamma-encoded, in which the dark parts' edges count as much as the bright ones'. An edge is a
    gradient of luminance after a Gaussian of sigma 1; a pixel has the strongest one in a window of 1/64 of the image.
    """
    import cv2

    luminance = cv2.GaussianBlur(encoded @ _LUMINANCE, (0, 0), 1)
    gradient = np.hypot(cv2.Scharr(luminance, cv2.CV_32F, 1, 0), cv2.Scharr(luminance, cv2.CV_32F, 0, 1))
    edges = window_max(gradient, 2 * (max(gradient.shape) // 128) + 1)
    smooth = edges <= np.quantile(edges, share)
    _, labels, about, _ = cv2.connectedComponentsWithStats(smooth.astype(np.uint8), connectivity=4)
    largest = 1 + int(about[1:, cv2.CC_STAT_AREA].argmax())  # label 0 is what is not smooth
    return np.asarray(labels == largest)


@dataclass(frozen=True, eq=False)
class OpenWater:
    """The colours of open water: the veiling light, and the Gaussian distribution around it.

    veiling_light: (3,) float32, the colour of median luminance in the area; mean: (3,) and whiten: (3, 3), which give a
    colour's Mahalanobis distance |whiten (I - mean)|; near, far: distances up to which a colour is water for sure, and
    from which it is something else for sure. The area's own mean distance and a standard deviation, and its greatest.
    """

    veiling_light: Array
    mean: Array
    whiten: Array
    near: float
    far: float

    @classmethod
    def of(cls, colours: Array) -> OpenWater:
        """Describe the colours (P, 3) of an area of open water."""
        luminance = colours @ _LUMINANCE
        middle = np.argpartition(luminance, len(luminance) // 2)[len(luminance) // 2]
        mean = colours.mean(axis=0, dtype=np.float64)
        offset = colours - mean
        covariance = offset.T @ offset / len(colours) + _QUANTISATION * np.eye(3)
        whiten = np.linalg.inv(np.linalg.cholesky(covariance))
        distance = np.linalg.norm(offset @ whiten.T, axis=1)
        near = float(distance.mean() + distance.std())
        far = max(float(distance.max()), near + 1)
        return cls(colours[middle], mean.astype(np.float32), whiten.astype(np.float32), near, far)

    def likeness(self, image: Array) -> Array:
        """Return (H, W) float32: 1 for colours of water, 0 for others, linear in the distance in between."""
        offset = (image - self.mean) @ self.whiten.T
        distance = np.sqrt(np.einsum("...c,...c", offset, offset))
        return np.asarray(((self.far - distance) / (self.far - self.near)).clip(0, 1), dtype=np.float32)
