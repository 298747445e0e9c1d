"""Brown's lens model, with all terms that photogrammetry tools fit.

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8) + (2 p1 x y + p2 (r^2 + 2 x^2)) (1 + p3 r^2 + p4 r^4)
    y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8) + (2 p2 x y + p1 (r^2 + 2 y^2)) (1 + p3 r^2 + p4 r^4)

Then K is applied, with its skew if it has one. A fisheye first turns x, y into the angle from the axis. OpenCV has no
k4, p3, p4, no skew, and no p1, p2 for a fisheye; a lens without these is a plain `Lens`.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.camera import Camera
from sucre_bench.loading.lens import Lens


def lens_of(
    camera: Camera, model: Literal["perspective", "fisheye"], k: tuple[float, ...], p: tuple[float, ...]
) -> Lens:
    """Return the lens of a camera, at its size, with k1 to k4 and p1 to p4 of the formulas above, the last left out."""
    k, p = (*k, *[0.0] * (4 - len(k))), (*p, *[0.0] * (4 - len(p)))
    if camera.K[0, 1] == 0 and model == "fisheye" and not any(p):
        return Lens(camera, model, k)
    if camera.K[0, 1] == 0 and model == "perspective" and not any((k[3], p[2], p[3])):
        known = (k[0], k[1], p[0], p[1], k[2])
        return Lens(camera, model, known if any(known) else ())
    return BrownLens(camera, model, (*k, *p))


@dataclass(frozen=True, eq=False)
class BrownLens(Lens):
    """A camera as it photographs; coefficients: k1 k2 k3 k4 p1 p2 p3 p4 of the formulas above."""

    @property
    def identity(self) -> tuple[object, ...]:
        """What identifies this lens, for hashes."""
        return ("brown", self.camera.K.tolist(), self.camera.width, self.camera.height, self.model, self.coefficients)

    def bent(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return x', y' of rays x, y at unit depth, arrays of one shape."""
        k1, k2, k3, k4, p1, p2, p3, p4 = self.coefficients
        if self.model == "fisheye":
            r = np.maximum(np.sqrt(x * x + y * y), 1e-9)
            angle = np.arctan(r) / r
            x, y = x * angle, y * angle
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)))
        more = 1 + r2 * (p3 + r2 * p4)
        return (
            x * radial + (2 * p1 * x * y + p2 * (r2 + 2 * x * x)) * more,
            y * radial + (2 * p2 * x * y + p1 * (r2 + 2 * y * y)) * more,
        )

    def _sources(self, size: tuple[int, int], to: Camera) -> tuple[Array, Array]:
        scale = np.diag([size[0] / self.camera.width, size[1] / self.camera.height, 1.0])
        (fx, skew, cx), (_, fy, cy) = (scale @ self.camera.K)[:2].tolist()  # floats, which leave float32 as it is
        u, v = (
            ((np.arange(side) + 0.5 - to.K[i, 2]) / to.K[i, i]).astype(np.float32)
            for i, side in enumerate((to.width, to.height))
        )
        x, y = self.bent(*np.meshgrid(u, v))
        return fx * x + skew * y + (cx - 0.5), fy * y + (cy - 0.5)
