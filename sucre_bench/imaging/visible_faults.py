"""What the eye sees wrong in restored pictures, from the pictures and their photographs alone.

`look_at` measures one picture beside its photograph; `faults_of_dive` compares the looks of a dive with the limits.
Pictures are looked at with at most 480 pixels on a side, as on a screen. docs/metric-evidence.md has how often each
fault is named rightly. A cast and a turning hue are those of the nearest third of the ground: there the water has
changed least, so a photograph, with its brightest ground made white, shows nearly the right colours.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array, Mask, coloured, once
from sucre_bench.imaging.cielab import to_lab
from sucre_bench.imaging.image_formation import reduced

LIMITS = {
    "cast": 22.0,  # a*b* distance of the nearest third from the photograph's whose brightest quarter is made gray
    "red": 0.08,  # share of saturated reds of HSV, dark ones too, that are not red in the photograph
    "rims": 0.25,  # share of pixels at edges of depth with another hue than around, in the picture only
    "turning": 20.0,  # a*b* distance of the nearest third from that of the other pictures, beyond the photographs'
    "below": 1 / 3,  # share of a channel below zero
}

_SIDE = 480
_FEWEST = 50  # pixels that a median is taken of


@dataclass(frozen=True)
class VisibleFault:
    """A fault of a picture. kind: a key of `LIMITS`; value: above the limit."""

    kind: str
    value: float
    limit: float


@dataclass(frozen=True)
class Look:
    """One picture beside its photograph, in numbers; NaN where they are not known.

    cast, red, rims, below: see `LIMITS`; near, was_near: (a*, b*) of the nearest third in picture and photograph.
    """

    cast: float
    red: float
    rims: float
    below: float
    near: tuple[float, float]
    was_near: tuple[float, float]


def look_at(picture: Array, photograph: Array, distance: Array | None = None, below: float = math.nan) -> Look:
    """Measure a picture beside its photograph.

    picture, photograph: (H, W, 3) in [0, 1], gamma-encoded, NaN where a pixel has no colour or is only guessed;
    distance: (H, W) metres, 0 where unknown; without one all ground counts as near, and rims are not known; below:
    share of the worst channel below zero before display, if known.
    """
    import cv2

    small, was = on_screen(picture), on_screen(photograph)
    seen = coloured(small) & coloured(was)
    if np.count_nonzero(seen) < _FEWEST:
        return Look(math.nan, math.nan, math.nan, below, (math.nan, math.nan), (math.nan, math.nan))
    near, rims = seen, math.nan
    lab, lab_was = to_lab(np.nan_to_num(small)), to_lab(np.nan_to_num(was))
    if distance is not None:
        size = seen.shape[::-1]
        metres = cv2.resize(distance.astype(np.float32), size, interpolation=cv2.INTER_NEAREST_EXACT)
        known = seen & (metres > 0)
        if np.count_nonzero(known) >= _FEWEST:
            near = known & (metres <= np.quantile(metres[known], 1 / 3))
    ground, ground_was = np.median(lab[near], axis=0)[1:], np.median(lab_was[near], axis=0)[1:]
    light = lab_was[near][:, 0]
    white = np.median(lab_was[near][light >= np.quantile(light, 0.75)], axis=0)[1:]
    cast = float(np.hypot(*(ground - (ground_was - white))))
    red = float((_is_red(small, 0.5) & ~_is_red(was, 0.25))[seen].mean())
    (a, b), (a_was, b_was) = ground.tolist(), ground_was.tolist()
    return Look(cast, red, rims, below, (a, b), (a_was, b_was))


def faults_of_dive(looks: Sequence[Look]) -> list[tuple[VisibleFault, ...]]:
    """Return the faults of each picture of a dive; looks: of all its views, in any order."""
    near, was = (np.array([getattr(one, name) for one in looks]).reshape(-1, 2) for name in ("near", "was_near"))
    turned = np.zeros(len(looks))
    if np.isfinite(near).all(axis=-1).any():
        away, was_away = (np.hypot(*(one - np.nanmedian(one, axis=0)).T) for one in (near, was))
        turned = away - was_away
    found = []
    for look, turning in zip(looks, turned.tolist(), strict=True):
        values = {"cast": look.cast, "red": look.red, "rims": look.rims, "turning": turning, "below": look.below}
        found.append(tuple(VisibleFault(k, v, LIMITS[k]) for k, v in values.items() if v > LIMITS[k]))
    return found


@once
def on_screen(picture: Array) -> Array:
    """Return a picture (H, W, 3) in [0, 1] with at most 480 pixels on a side; NaN where a part has no colour."""
    return reduced(picture.astype(np.float32), _SIDE)


def _is_red(picture: Array, saturation: float) -> Mask:
    """Whether the hue of HSV is within 25 degrees of red, at this saturation or more, and a value of 0.1 or more."""
    red, green, blue = np.moveaxis(picture, -1, 0)
    chroma = red - np.minimum(green, blue)
    is_hue = (red >= green) & (red >= blue) & (np.abs(green - blue) * 60 <= 25 * chroma)
    return np.asarray(is_hue & (red > 0.1) & (chroma > saturation * red))
