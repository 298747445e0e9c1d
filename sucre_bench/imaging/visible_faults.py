"""What the eye sees wrong in a restored picture beside its photograph, and in the pictures of a dive together.

`look_at` measures one picture; `faults_of_dive` compares the pictures of a dive with `LIMITS`. Both look at pictures
with at most 480 pixels on a side, as on a screen. docs/formulas.md has how often the faults are named rightly.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array, Mask, coloured, once
from sucre_bench.imaging.cielab import to_lab
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.imaging.image_formation import reduced

LIMITS = {
    "cast": 15.4,  # a*b* distance of a third of the ground from all that a white balance makes of the photograph
    "red": 0.045,  # share of saturated reds, dark ones too, that are no red in the photograph
    "rims": 0.12,  # share of pixels at steps of depth whose colour differs from the ground beside, in the picture only
    "flat": 0.03,  # share of pixels without texture where the photograph has some
    "turning": 6.0,  # a*b* distance of the brightest ground from that of other views, beyond the photographs'
    "below": 1 / 3,  # share of a channel below zero
}

_SIDE = 480
_FEWEST = 50  # pixels of which a median is taken
# a restored colour may have so much of the chroma that white balance gives it
_MORE_SATURATED = 2.0
_UNSURE = 0.2  # the error of a white balance, as a share of the chroma that it removes from the brightest ground
# ratio of distances at an edge
_STEP = 1.25
# share of the picture that edges must have
_LEAST_EDGES = 0.005
# side of the square around an edge pixel
_BESIDE_PX = 31
# a*b* distance of a rim
_STANDS_OUT = 15.0
# least standard deviation that is texture
_TEXTURE = 0.008
# share of it that is none
_LESS = 0.25
_WAS_RED_HUE_DEG = 25
_RED_HUE_DEG = 15


@dataclass(frozen=True)
class VisibleFault:
    """A fault of a picture."""

    kind: str
    """A key of `LIMITS`."""

    value: float
    """Above the limit."""

    limit: float


@dataclass(frozen=True)
class Look:
    """One picture beside its photograph in numbers, NaN where one is not known."""

    # See `LIMITS`.
    cast: float = math.nan
    red: float = math.nan
    rims: float = math.nan
    flat: float = math.nan
    below: float = math.nan

    # The a* and b* of the brightest ground, in the picture and in the photograph.
    light: tuple[float, float] = (math.nan, math.nan)
    was_light: tuple[float, float] = (math.nan, math.nan)

    hue_deg: float = math.nan
    """Of the third of the ground with the strongest cast, in CIE Lab."""


def look_at(
    picture: Array, photograph: Array, distance: Array | None = None, below: float = math.nan
) -> Look:
    """Measure a picture beside its photograph.

    picture, photograph: (H, W, 3) in [0, 1], gamma-encoded, NaN where a pixel has no colour; distance: (H, W) metres,
    0 where unknown. Only pixels with a distance count as ground; without distances all pixels do. below: share of the
    worst channel that is below zero before display, if known.
    """
    import cv2

    small, was = on_screen(picture), on_screen(photograph)
    seen = coloured(small) & coloured(was)
    if np.count_nonzero(seen) < _FEWEST:
        return Look(below=below)
    small, was = np.nan_to_num(small), np.nan_to_num(was)
    metres: Array = np.ones(seen.shape, np.float32)
    if distance is not None:
        size = seen.shape[::-1]
        metres = np.asarray(
            cv2.resize(distance.astype(np.float32), size, interpolation=cv2.INTER_NEAREST_EXACT)
        )
    ground = seen & (metres > 0)
    if np.count_nonzero(ground) < _FEWEST:
        metres = np.ones_like(metres)
        ground = seen
    labs = to_lab(small), to_lab(was)
    is_bright = _parts(labs[1][ground][:, 0])[-1]
    (a, b), (a_was, b_was) = (
        np.median(lab[ground][is_bright], axis=0)[1:].tolist() for lab in labs
    )
    cast, hue_deg = _cast(labs, was, metres, ground)
    red = is_red(small, _RED_HUE_DEG, 0.5, 0.15) & ~is_red(was, _WAS_RED_HUE_DEG, 0.25, 0.15)
    rims, flat = _rims(labs, metres, ground), _flat(small, was, seen)
    return Look(
        cast, float(red[seen].mean()), rims, flat, below, (a, b), (a_was, b_was), hue_deg
    )


def faults_of_dive(looks: Sequence[Look]) -> list[tuple[VisibleFault, ...]]:
    """Return the faults of each picture of a dive; looks: of its views, in any order."""
    found = []
    for look, turning in zip(looks, turning_of(looks), strict=True):
        values = {"turning": turning} | {
            kind: getattr(look, kind) for kind in LIMITS if kind != "turning"
        }
        found.append(
            tuple(
                VisibleFault(k, values[k], limit)
                for k, limit in LIMITS.items()
                if values[k] > limit
            )
        )
    return found


def turning_of(looks: Sequence[Look]) -> list[float]:
    """Return by how much more the brightest ground of each picture differs from the dive's than in the photographs.

    The dive's is the median over its views; differences are distances in a* and b*.
    """
    apart = []
    for name in ("light", "was_light"):
        lights = np.array([getattr(look, name) for look in looks]).reshape(-1, 2)
        known = lights[np.isfinite(lights).all(axis=-1)]
        middle = np.median(known, axis=0) if len(known) else np.zeros(2)
        apart.append(np.hypot(*(lights - middle).T))
    return (apart[0] - apart[1]).tolist()


@once
def on_screen(picture: Array) -> Array:
    """Return a picture (H, W, 3) in [0, 1] with at most 480 pixels on a side; NaN where a part has no colour."""
    return reduced(picture.astype(np.float32), _SIDE)


def _parts(lightness: Array) -> list[Mask]:
    """The darkest quarter of the pixels, the middle half, and the brightest quarter."""
    low, high = np.quantile(lightness, [0.25, 0.75])
    return [lightness <= low, (lightness > low) & (lightness < high), lightness >= high]


def _cast(
    labs: tuple[Array, Array], was: Array, metres: Array, ground: Mask
) -> tuple[float, float]:
    """Return the largest cast of the nearest, middle and farthest third of the ground, and its hue in degrees.

    A third of the photograph whose brightest quarter is made gray shows nearly the right hues. A restored colour lies
    between the photograph's and that one, or is more saturated than that one. The cast is the root mean square distance
    of the median a* and b* from there, over the darkest quarter, the middle half and the brightest quarter, less the
    error of the white balance.
    """
    limits = np.quantile(metres[ground], [0, 1 / 3, 2 / 3, 1])
    found = [(math.nan, math.nan)]
    # a set: without distances, the thirds are one
    for near, far in set(itertools.pairwise(limits)):
        third = ground & (metres >= near) & (metres <= far)
        if np.count_nonzero(third) < _FEWEST:
            continue
        lab, lab_was = (one[third] for one in labs)
        parts = _parts(lab_was[:, 0])
        linear = srgb_decode(was[third])
        white = np.median(linear[parts[-1]], axis=0)
        balanced = to_lab(srgb_encode(linear * white.mean() / np.maximum(white, 1e-4))[None])[0]
        apart = []
        shifts = []
        chroma = float(np.hypot(*np.median(lab_was[parts[-1]], axis=0)[1:]))
        a_and_b = np.hstack([one[:, 1:] for one in (lab, lab_was, balanced)])
        for part in (part for part in parts if part.any()):
            now, before, right = np.median(a_and_b[part], axis=0).reshape(3, 2)
            apart.append(
                min(
                    _from_line(now, before, right),
                    _from_line(now, right, _MORE_SATURATED * right),
                )
            )
            shifts.append(now)
        a, b = np.mean(shifts, axis=0)
        cast = float(np.sqrt(np.mean(np.square(apart)))) - _UNSURE * chroma
        found.append((max(0.0, cast), float(np.degrees(np.arctan2(b, a)) % 360)))
    return max(found, key=lambda one: -1 if math.isnan(one[0]) else one[0])


def _from_line(point: Array, start: Array, end: Array) -> float:
    """The distance of a point from the line between two others."""
    way = end - start
    share = np.clip((point - start) @ way / max(float(way @ way), 1e-9), 0, 1)
    return float(np.hypot(*(point - start - share * way)))


def is_red(colours: Array, hue_deg: float, saturation: float, value: float) -> Mask:
    """Return which colours (..., 3) in [0, 1] have a hue of HSV so near to red, and saturation and value above these.

    With red as the maximum, the hue is 60 degrees times (G - B) / (maximum - minimum), and the saturation is
    (maximum - minimum) / maximum.
    """
    red, green, blue = np.moveaxis(colours, -1, 0)
    chroma = red - np.minimum(green, blue)
    is_hue = (red >= green) & (red >= blue) & (np.abs(green - blue) * 60 <= hue_deg * chroma)
    return np.asarray(is_hue & (red > value) & (chroma > saturation * red))


def _rims(labs: tuple[Array, Array], metres: Array, ground: Mask) -> float:
    """The share of pixels at steps of depth whose hue stands out; NaN where the ground has few such steps."""
    import cv2

    log = np.log(np.maximum(metres, 1e-6))
    square = np.ones((5, 5), np.uint8)
    near, far = (
        cv2.erode(np.where(ground, log, 99), square),
        cv2.dilate(np.where(ground, log, -99), square),
    )
    edge = ground & (far - near > math.log(_STEP))
    if edge.mean() < _LEAST_EDGES:
        return math.nan
    beside = (ground & ~edge).astype(np.float32)
    n = cv2.blur(beside, (_BESIDE_PX, _BESIDE_PX))
    apart = []
    for lab in labs:
        around = (
            cv2.blur(lab[..., 1:] * beside[..., None], (_BESIDE_PX, _BESIDE_PX))
            / np.maximum(n, 1e-3)[..., None]
        )
        apart.append(np.hypot(*np.moveaxis(lab[..., 1:] - around, -1, 0)))
    return float((apart[0] > apart[1] + _STANDS_OUT)[edge].mean())


def _flat(picture: Array, photograph: Array, seen: Mask) -> float:
    """The share of pixels whose surroundings have texture in the photograph, and no quarter of it in the picture."""
    import cv2

    inside = cv2.erode(seen.astype(np.uint8), np.ones((7, 7), np.uint8)) > 0
    if not inside.any():
        return math.nan
    rough = []
    for image in (picture, photograph):
        gray = image.mean(axis=-1)
        rough.append(
            np.sqrt(np.maximum(cv2.blur(gray * gray, (7, 7)) - cv2.blur(gray, (7, 7)) ** 2, 0))
        )
    return float(((rough[0] < _LESS * rough[1]) & (rough[1] > _TEXTURE))[inside].mean())
