"""How a lens bends a ray, by the published formulas: Brown (1966), and Kannala and Brandt (2006)."""

from collections.abc import Sequence
from typing import Any

import numpy as np


def bent(
    x: Any, y: Any, is_fisheye: bool, k: Sequence[float], p: Sequence[float] = (0, 0)
) -> tuple[Any, Any]:
    """Where a lens of focal length 1 images the ray (x, y, 1). k: four radial terms; p: two tangential ones."""
    r = np.hypot(x, y)
    by = np.arctan(r) if is_fisheye else r
    radial = 1 + k[0] * by**2 + k[1] * by**4 + k[2] * by**6 + k[3] * by**8
    if is_fisheye:
        return x * radial * by / r, y * radial * by / r
    return (
        x * radial + 2 * p[0] * x * y + p[1] * (r**2 + 2 * x**2),
        y * radial + p[0] * (r**2 + 2 * y**2) + 2 * p[1] * x * y,
    )
