"""A depth or distance map as a picture: near is red, far is blue, by the colour map Turbo (Mikhailov 2019)."""

import numpy as np

from sucre_bench.arrays import Array


def depth_colours(depth: Array, near: float, far: float, unknown: int) -> np.ndarray:
    """Return a picture (h, w, 3) uint8 RGB of a map (h, w), 0 = unknown.

    near, far: the values at the ends of the colour map; unknown: the gray, 0 to 255, for unknown values.
    """
    import cv2

    share = ((depth - near) / max(far - near, 1e-9)).clip(0, 1)
    coloured = cv2.applyColorMap(np.rint(255 * (1 - share)).astype(np.uint8), cv2.COLORMAP_TURBO)[..., ::-1].copy()
    coloured[depth <= 0] = unknown
    return np.asarray(coloured)
