"""Charts painted into images, in known colours."""

from __future__ import annotations

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.chart_kinds import ChartKind

TILTED = np.array([[61.0, 40.0], [352.0, 22.0], [377.0, 268.0], [33.0, 241.0]])


def painted(kind: ChartKind, corners: Array, size: tuple[int, int] = (300, 420), share: float = 1.0) -> Array:
    """A white image with every patch in its sRGB colour, on the middle `share` of its box (in x and y)."""
    import cv2

    image = np.ones((*size, 3), np.float32)
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    homography = cv2.getPerspectiveTransform(np.asarray(corners, np.float32), unit)
    v, u = np.mgrid[: size[0], : size[1]] + 0.5
    x, y = cv2.perspectiveTransform(np.stack([u, v], -1).reshape(1, -1, 2), homography)[0].T.reshape(2, *size)
    for patch in kind.patches:
        x0, y0, x1, y1 = patch.box
        inside = np.abs(x - (x0 + x1) / 2) <= share * (x1 - x0) / 2
        inside &= np.abs(y - (y0 + y1) / 2) <= share * (y1 - y0) / 2
        image[inside] = patch.srgb
    return image
