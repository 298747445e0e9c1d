"""Corrects colours at edges of depth and of texture, where the views of a pixel do not show what the target shows.

Depth maps of real dives are off by some pixels at outlines. A pixel of a near board then has the distance of the ground
behind it, and pairs with ground in other views. Its colour becomes a mixture, removed through the wrong length of
water: a bright or cyan fringe. Wrong by one pixel, pairs do the same at edges of texture.

The target's own intensity I is what the picture shows. A pixel is *contradicted* if its own colour J_o = (I - b) / a
differs from J by much more than noise explains, compared with how much they differ around it (light differs between
views, which is no contradiction):

    e = (J_o - J) - mean of the same over the window,    chi = (e a / s)^2, mean over channels,

where s is the typical e a of pixels at a similar distance, from its median.

1. A contradicted pixel near an edge of depth takes the side whose pixels look like it in the photograph, with weights
   exp(-|I - I_q|^2 / 2 s^2), if these are many on the other side and few on its own. Its colour is its own intensity
   at that side's distance.
2. Specks stay as the other views show them: a few contradicted pixels side by side, whose own observation robust
   weights call wrong while two others agree. Marine snow looks like that.
3. Other contradicted pixels take their own detail: J + e, faded in between two thresholds of chi. One observation
   tells no more than all of them, so their standard deviation does not fall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.machine.compute import compiled
from sucre_bench.methods.sucre.model import WaterParameters, inverted
from sucre_bench.methods.sucre.refine_noise import box_sum, robust_part
from sucre_bench.methods.sucre.robust import WRONG
from sucre_bench.multiview.observations import Observations

# Half a window, of means and of sides, as a share of the image's width; at least so many pixels.
_HALF, _FEWEST = 0.005, 3

# Distances on two sides of an edge differ by at least this factor.
_STEP = 1.1

# Differences count in means up to so many typical ones.
_CLIPPED = 3.0

# A pixel is contradicted from the first chi on, and wholly from the second on.
_DOUBT, _SURE = 9.0, 25.0

# Difference of intensities that look alike; the least mean weight of the other side, and how much more than the own.
_ALIKE, _LEAST, _MORE = 0.04, 0.2, 4.0

_DARK = 1e-3

# Pixels that typical differences are taken from, and entries of their table over distance.
_SAMPLE, _FINE = 200_000, 1000

# Sum of the robust weights of other views that agree.
_AGREE = 1.5

# Metres that no distance exceeds.
_FAR = 1e9

# Classes of distance, the median of the square of a standard normal number, and the least noise (8 bits).
_CLASSES, _MEDIAN_OF_SQUARE, _LEAST_NOISE = 12, 0.455, 2e-3


@dataclass(frozen=True, eq=False)
class Target:
    """What the target itself shows: intensity (H, W, 3) as fitted, picture (H, W, 3) as stored, distance (H, W) metres,
    0 where unknown; is_wrong (H, W): pixels that the other views agree to contradict, where robust weights tell.
    """

    intensity: Array
    picture: Array
    distance: Array
    is_wrong: Mask | None = None

    @property
    def half(self) -> int:
        return max(_FEWEST, round(_HALF * self.distance.shape[1]))


def corrected_edges(target: Target, J: Array, deviation: Array, water: WaterParameters) -> tuple[Array, Array]:
    """Return colours and standard deviations (H, W, 3) float32 with those of contradicted pixels corrected.

    J, deviation: NaN without depth. A corrected colour has the deviation of a single observation, as far as it is one.
    """
    known = np.isfinite(J + target.intensity).all(axis=-1) & (target.distance > 0)
    own, a = _alone(target.intensity, target.distance, water)
    difference = np.where(known[..., None], own - J, np.float32(0))
    most = _CLIPPED * _deviation(difference, a, target.distance, known)
    n = np.maximum(box_sum(known.astype(np.float32), target.half), 1)[..., None]
    e = difference - box_sum(difference.clip(-most, most).astype(np.float32), target.half) / n
    e[~known] = 0
    noise = _deviation(e, a, target.distance, known)
    chi = ((e / np.maximum(noise, _LEAST_NOISE / a)) ** 2).mean(axis=-1)
    share = np.where(known, np.clip((chi - _DOUBT) / (_SURE - _DOUBT), 0, 1), 0)[..., None]
    side = _other_side(target, share[..., 0] > 0)
    moved = side > 0
    if target.is_wrong is not None:
        share[_small_spots((share[..., 0] > 0) & ~moved, target.half**2) & target.is_wrong] = 0
    corrected = J + share * e
    corrected[moved], there = _alone(target.intensity[moved], side[moved], water)
    share[moved] = 1
    noise[moved] *= a[moved] / there
    rest = np.multiply(1 - share, deviation, out=np.zeros_like(noise), where=share < 1)  # deviations may be infinite
    left = np.sqrt(rest**2 + (share * noise) ** 2)
    least = np.where(np.isfinite(deviation) & ~moved[..., None], deviation, 0)
    left = np.maximum(left, least)  # one observation tells no more than all of them
    return corrected.astype(np.float32), np.where(share > 0, left, deviation).astype(np.float32)


def wrong_in_target(observations: Observations, weight: Array, target: str) -> Mask:
    """Return (H, W) the pixels whose own observation is wrong while at least two others agree.

    observations: with `view`, without robust weights; weight: (N,) with them; target: name of the view.
    """
    assert observations.view is not None, "observe with views"
    place = np.concatenate([np.arange(n) for n, _ in observations.slots()])
    v = np.atleast_2d(robust_part(observations, weight, slice(None))).max(axis=0)
    is_own = observations.view == observations.views.index(target)
    others, own = np.bincount(place[~is_own], v[~is_own], len(observations.pixels)), place[is_own]
    wrong = np.zeros(observations.shape, dtype=bool)
    wrong.ravel()[observations.pixels[own[(v[is_own] < WRONG) & (others[own] > _AGREE)]]] = True
    return wrong


def _small_spots(contradicted: Mask, most: int) -> Mask:
    """Return those (H, W) of the contradicted pixels that form spots of at most so many."""
    import cv2

    _, spot, sizes, _ = cv2.connectedComponentsWithStats(contradicted.astype(np.uint8), connectivity=8)
    return np.asarray(contradicted & (sizes[spot, cv2.CC_STAT_AREA] <= most))


def _alone(intensity: Array, distance: Array, water: WaterParameters) -> tuple[Array, Array]:
    """Return the colours (..., 3) that intensities alone have at distances (...,), and the transmission."""
    parameters = (column.astype(np.float32)[:, 0] for column in water.columns())
    return inverted(intensity.astype(np.float32), distance[..., None].astype(np.float32), parameters, _DARK)


def _deviation(e: Array, a: Array, distance: Array, known: Mask) -> Array:
    """Return the typical size (H, W, 3) of differences e of colours: that of e a at similar distances, over a."""
    places = np.flatnonzero(known)
    few = places[:: max(1, len(places) // _SAMPLE)]
    few = few[np.argsort(distance.ravel()[few], kind="stable")]
    z, squares = distance.ravel()[few], (e.reshape(-1, 3)[few] * a.reshape(-1, 3)[few]) ** 2
    classes = [part for part in np.array_split(np.arange(len(z)), _CLASSES) if len(part)]
    middle = [z[part].mean() for part in classes]
    typical = np.sqrt([np.median(squares[part], axis=0) / _MEDIAN_OF_SQUARE for part in classes])
    if not classes:
        return np.ones_like(a)
    fine = np.linspace(middle[0], middle[-1], _FINE)  # a table: distances are many
    table = np.stack([np.interp(fine, middle, of_channel) for of_channel in typical.T], axis=-1).astype(np.float32)
    step = max((middle[-1] - middle[0]) / (_FINE - 1), 1e-9)
    return np.asarray(table[((distance - middle[0]) / step).clip(0, _FINE - 1).astype(np.int32)] / a)


def _other_side(target: Target, contradicted: Mask) -> Array:
    """Return (H, W) the distance of the other side for pixels that look like it, 0 for the others."""
    import cv2

    side = np.zeros(target.distance.shape, dtype=np.float32)
    window = np.ones((4 * target.half + 1,) * 2, np.uint8)
    known = target.distance > 0
    farthest = cv2.dilate(np.where(known, target.distance, 0).astype(np.float32), window)
    nearest = cv2.erode(np.where(known, target.distance, _FAR).astype(np.float32), window)
    contradicted = contradicted & (farthest > _STEP * nearest)
    picture = np.ascontiguousarray(np.nan_to_num(target.picture, nan=-9.0), dtype=np.float32)  # like no other
    distance = np.ascontiguousarray(target.distance, dtype=np.float32)
    compiled(_find_side)(picture, distance, contradicted, 2 * target.half, side)
    return side


def _find_side(picture: Array, distance: Array, contradicted: Array, half: int, side: Array) -> None:
    rows, columns = distance.shape
    for y in range(rows):
        for x in range(columns):
            if not contradicted[y, x]:
                continue
            z = distance[y, x]
            own = other = own_n = other_n = total = 0.0
            for v in range(max(0, y - half), min(rows, y + half + 1), 2):
                for u in range(max(0, x - half), min(columns, x + half + 1), 2):
                    d = distance[v, u]
                    if not d > 0 or contradicted[v, u]:
                        continue
                    square = 0.0
                    for c in range(3):
                        square += (picture[v, u, c] - picture[y, x, c]) ** 2
                    w = math.exp(-0.5 * square / (_ALIKE * _ALIKE))
                    if d > z * _STEP or z > d * _STEP:
                        other += w
                        other_n += 1
                        total += w * d
                    else:
                        own += w
                        own_n += 1
            if other_n > 0 and other > _LEAST * other_n and other / other_n > _MORE * own / max(own_n, 1.0):
                side[y, x] = total / other
