"""Water between camera and scene: how much of it each pixel is seen through, and an image without it.

Like `View.distance`, distances are Euclidean, in metres, 0 = unknown.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from sucre_bench.errors import NotApplicableError
from sucre_bench.scene import Array, View

__all__ = ["distances", "without_water"]

_DEEPEST = 20.0  # optical depth: exp(20) is 5e8, which makes a picture of no camera's noise, and is no overflow


def distances(view: View) -> tuple[Array, Literal["distance", "depth"]]:
    """Return how far every pixel is seen, (H, W) float32 metres, 0 = unknown, and what it is measured along.

    Where the view has no camera, "depth" along the optical axis takes the place of the Euclidean "distance".
    Raises NotApplicableError where no pixel has depth.
    """
    if not view.valid.any():
        raise NotApplicableError(f"{view.name}: no pixel has depth")
    return (view.depth, "depth") if view.camera is None else (view.distance, "distance")


def without_water(
    image: Array, z: Array, veil: Callable[[Array, int], Array], optical_depth: Callable[[Array, int], Array]
) -> Array:
    """Return J = (I - veil(z)) exp(optical_depth(z)), (H, W, 3) float32, NaN where z is 0 (SUCRe, eq. 3).

    image: (H, W, 3); z: (H, W) metres, 0 = unknown; veil, optical_depth: functions of distances (P,) and of a channel;
    beyond an optical depth of 20 no more is undone.
    """
    seen = z > 0
    through = z[seen]
    J = np.full(image.shape, np.nan, dtype=np.float32)
    for c in range(3):  # a channel at a time: the planes of 24 megapixels add up
        J[seen, c] = (image[..., c][seen] - veil(through, c)) * np.exp(np.minimum(optical_depth(through, c), _DEEPEST))
    return J
