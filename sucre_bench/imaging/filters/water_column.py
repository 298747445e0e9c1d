"""The water between camera and scene: its length for each pixel, its effect, and an image without it.

Like `View.distance`, distances are Euclidean, in metres, 0 = unknown. Channels are red, green, blue.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.errors import NotApplicableError
from sucre_bench.scene import View

_DEEPEST = 20.0  # optical depth: exp(20) is 5e8, which makes a picture of no camera's noise, and is no overflow
# Below this share of the distance, a range of distances says nothing about how light changes with it.
_FLAT = 0.02
_TRUSTED = 99  # per cent of the distances


@dataclass(frozen=True, slots=True)
class TwoTerm:
    """One channel's attenuation, beta(z) = a exp(-b z) + c exp(-d z) (Akkaynak & Treibitz 2019, eq. 11), all in 1/m.

    With a alone it is constant.
    """

    a: float
    b: float = 0.0
    c: float = 0.0
    d: float = 0.0

    def __call__(self, z: Array) -> Array:
        """Return beta (...), 1/m, at distances z (...) in metres."""
        return np.asarray(self.a * np.exp(-self.b * z) + self.c * np.exp(-self.d * z))

    def optical_depth(self, z: Array) -> Array:
        """Return beta(z) z (...), of which light keeps exp(-beta(z) z), at distances z (...) in metres."""
        return np.asarray(self(z) * z if self.b or self.c else self.a * z)


def distances(view: View) -> tuple[Array, Literal["distance", "depth"]]:
    """Return how far every pixel is seen, (H, W) float32 metres, 0 = unknown, and what it is measured along.

    Where the view has no camera, "depth" along the optical axis takes the place of the Euclidean "distance".
    Raises NotApplicableError where no pixel has depth.
    """
    if not view.valid.any():
        raise NotApplicableError(f"{view.name}: no pixel has depth")
    return (view.depth, "depth") if view.camera is None else (view.distance, "distance")


def trusted(z: Array) -> Mask:
    """Return which distances (...) water may be fitted to: the known ones, without the farthest hundredth of them.

    There are the wrong ones, of open water or of stereo gone astray: a few at 300 m would decide how light fades. Of a
    hundred or fewer, all are kept.
    """
    known: Mask = z > 0
    return known & (z <= np.percentile(z[known], _TRUSTED, method="higher")) if known.any() else known


def is_flat(z: Array) -> bool:
    """Return whether distances (P,) are about equal, so that they do not tell veil from attenuation."""
    return bool(z.max() - z.min() < _FLAT * z.max())


def channels(where: Mask) -> str:
    """Return the names of the channels where (3,) is true: "red, blue"."""
    return ", ".join(name for name, is_so in zip(("red", "green", "blue"), where, strict=True) if is_so)


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
