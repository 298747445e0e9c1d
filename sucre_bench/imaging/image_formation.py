"""Models of an image under water, and images without it.

By transmission: I = J t + A (1 - t), so that J = (I - A) / t + A. I: image, J: the scene without the water between it
and the camera, A: veiling light, (3,), the colour of water so deep that nothing is seen through it; t: transmission,
the share of the scene's light that arrives (Schechner & Karpel 2005; He, Sun & Tang 2011). Methods differ in how they
find A and t; this is what is the same in several of them.

By distance: J = (I - veil(z)) exp(beta(z) z) (SUCRe, eq. 3). Like `View.distance`, distances z are Euclidean, in
metres, 0 = unknown. Channels are red, green, blue.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from sucre_bench.arrays import CHANNELS, Array, Mask
from sucre_bench.errors import NotApplicableError
from sucre_bench.scene import Restoration, View, Water


def highest(plane: Array, share: float) -> Mask:
    """Return (H, W): the pixels that hold the highest `share` of values, at least one, and all that equal the last."""
    n = max(1, round(share * plane.size))
    least = np.partition(plane, plane.size - n, axis=None)[plane.size - n]
    return np.asarray(plane >= least)


def brightest(image: Array, among: Mask) -> Array:
    """Return (3,) float64: the colour of the brightest of some pixels (H, W), by R + G + B; of equals, the first."""
    # (P, 3): one index counts pixels, another channels
    colours = image[among].astype(np.float64)
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
    difference = np.stack(
        [np.abs(A[k] - [image[..., k].min(), image[..., k].max()]).max() for k in range(3)]
    )
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


def restoration(
    image: Array, veiling_light: Array, transmission: Array, **info: Any
) -> Restoration:
    """Return what a method gives that knows A and t: J and A."""
    unknown = np.full(3, np.nan)
    return Restoration(
        recovered(image, veiling_light, transmission),
        Water(np.asarray(veiling_light, dtype=np.float64), unknown, unknown),
        info=info,
    )


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


@dataclass(frozen=True, slots=True)
class ChannelWater:
    """One channel's water."""

    B: float
    """The veiling light."""

    gamma: float
    """Coefficient of its backscatter, 1/m."""

    beta: TwoTerm
    """Attenuation over distance, beta(z), 1/m."""

    def veil(self, z: Array) -> Array:
        """Return B (1 - exp(-gamma z)) at distances z (P,) in metres."""
        return np.asarray(self.B * -np.expm1(-self.gamma * z))


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
    return (
        known & (z <= np.percentile(z[known], _TRUSTED, method="higher"))
        if known.any()
        else known
    )


def undetermined(z: Array, if_flat: str, doubts: Mapping[str, Mask]) -> str:
    """Return what a view cannot tell, in words; "" where it can.

    z: (P,) distances; if they are about equal, they do not tell veil from attenuation, which leaves `if_flat`; doubts:
    in which channels (3,) each thing is in doubt.
    """
    if z.max() - z.min() < _FLAT * z.max():
        return f"all pixels are about equally far: {if_flat}"
    named = {
        what: [name for name, is_so in zip(CHANNELS, where, strict=True) if is_so]
        for what, where in doubts.items()
    }
    return "; ".join(f"{what} of {', '.join(names)}" for what, names in named.items() if names)


def without_water(
    image: Array,
    z: Array,
    water: Sequence[ChannelWater],
    optical_depth: Callable[[TwoTerm, Array], Array] = TwoTerm.optical_depth,
) -> Array:
    """Return J = (I - veil(z)) exp(optical depth), (H, W, 3) float32, NaN where z is 0 (SUCRe, eq. 3).

    image: (H, W, 3); z: (H, W) metres, 0 = unknown; water: of each channel; optical_depth: what is undone of a
    channel's beta at distances (P,); beyond 20 no more is undone.
    """
    seen = z > 0
    through = z[seen]
    J = np.full(image.shape, np.nan, dtype=np.float32)
    for c, of in enumerate(water):  # a channel at a time: the planes of 24 megapixels add up
        undone = np.exp(np.minimum(optical_depth(of.beta, through), _DEEPEST))
        J[seen, c] = (image[..., c][seen] - of.veil(through)) * undone
    return J
