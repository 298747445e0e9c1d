"""Corrects colours where single views have gaps, and at edges, where other views do not show what the target shows.

**Gaps.** Views of a point never agree fully: light, exposure and the model's errors differ. A pixel that one view
misses, between pixels that it shows, then has another colour than they. Pairs of pixels leave such gaps in dots and
lines wherever scales differ, and a step where the field of a view ends.

Let e be how far the colour that a view v alone gives is from the colour that the target's own intensity gives. Its mean
m_v over a window is what v changes there systematically. With a view's information A_v = w a^2, and the target's own
A_o,

    s  = sum_shown A_v m_v / (A_o + sum_shown A_v)               is what the views have changed at a pixel, and
    s* = sum f_v A_v m_v / (A_o + sum f_v A_v)                   what they would have, had none of them a gap;

f_v is 1 inside the field of view v and falls to 0 at its rim. The result is J + s* - s. Detail and noise stay as they
are: only means over windows are added. Where views agree, m_v is no larger than chance and counts as 0.

**Edges.** Depth maps of real dives are off by some pixels at outlines. A pixel of a near board then has the distance of
the ground behind it, and pairs with ground in other views. Its colour becomes a mixture, removed through the wrong
length of water: a bright or cyan fringe. Wrong by one pixel, pairs do the same at edges of texture.

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
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Indices, Mask
from sucre_bench.imaging.encoding import converted
from sucre_bench.imaging.fill import deviation_of_guess, fill_distances, filled_by_water
from sucre_bench.machine.compute import compiled
from sucre_bench.methods.sucre.model import WaterParameters, inverted
from sucre_bench.methods.sucre.refine_noise import ImagePrior, box_sum, robust_part
from sucre_bench.methods.sucre.robust import WRONG
from sucre_bench.multiview.observations import Observations
from sucre_bench.scene import Restoration, View

# Side of the window of a mean, the largest gap that is closed, and the width of a field's rim, pixels.
_WINDOW, _GAP, _RIM = 9, 7, 12.0

# A mean counts as far as its square exceeds so many times the square of its standard error.
_CHANCE = 4.0

# The least transmission and the least square of a number that is divided by.
_DARK, _LEAST_SQUARE = 1e-6, 1e-12

# Pixels of a window whose distance differs by no more than this share lie on one surface.
_SURFACE = 0.05

# The largest variance that counts. Larger ones say no more, and would leave rounding errors in running sums.
_ENDLESS = 1e4


def evened(observations: Observations, J: Array, water: WaterParameters, target: str) -> Array:
    """Return the colours without the pattern of gaps, (3, P) float32.

    observations: with `view`; J: (3, P), their colours in this water; target: the name of the restored view. Pixels
    that the target itself does not show stay as they are.
    """
    assert observations.view is not None, "observe with views"
    if target not in observations.views:
        return J
    shape, pixels = observations.shape, observations.pixels
    place = np.concatenate([np.arange(n, dtype=np.int32) for n, _ in observations.slots()])
    order = np.argsort(observations.view, kind="stable")
    ends = np.cumsum(np.bincount(observations.view, minlength=len(observations.views)))
    parameters = [column.astype(np.float32) for column in water.columns()]

    def shown_by(v: int) -> tuple[Indices, Array, Array]:
        """The pixels that a view shows, and images (H, W, 3) of their information A and colours J, 0 elsewhere."""
        at = order[ends[v - 1] if v else 0 : ends[v]]
        I = observations.colour[:, at].astype(np.float32) * np.float32(observations.scale)  # noqa: E741
        colours, a = inverted(I, observations.distance[at], parameters, _DARK)
        A = a * a if observations.weight is None else observations.weight[..., at] * a * a
        images = np.zeros((2, shape[0] * shape[1], 3), dtype=np.float32)
        images[0, pixels[place[at]]], images[1, pixels[place[at]]] = A.T, colours.T
        return pixels[place[at]], *images.reshape(2, *shape, 3)

    own = observations.views.index(target)
    _, A_o, J_o = shown_by(own)
    Am, A_sum, Am_whole, A_whole = np.zeros((4, *shape, 3), dtype=np.float32)
    for v in range(len(observations.views)):
        where, A, J_v = shown_by(v)
        if v == own or not len(where):  # a view whose light is not known
            continue
        sides = np.divmod(where, shape[1])
        part = tuple(slice(max(0, int(at.min()) - _WINDOW), int(at.max()) + _WINDOW + 1) for at in sides)
        A = A[part]
        there = np.asarray((A > 0).any(axis=-1))
        e = np.where((A > 0) & (A_o[part] > 0), J_v[part] - J_o[part], 0)
        n = np.maximum(box_sum(there.astype(np.float32), _WINDOW // 2), 1)[..., None]
        mean = box_sum(e, _WINDOW // 2) / n
        variance = np.maximum(box_sum(e * e, _WINDOW // 2) / n - mean**2, _LEAST_SQUARE)
        mean *= np.maximum(0, 1 - _CHANCE * variance / (n * np.maximum(mean**2, _LEAST_SQUARE)))
        whole = np.where(there[..., None], A, box_sum(A, _WINDOW // 2) / n) * _field(there)[..., None]
        for total, added in ((Am, A * mean), (A_sum, A), (Am_whole, whole * mean), (A_whole, whole)):
            total[part] += added
    change = Am_whole / np.maximum(A_o + A_whole, _LEAST_SQUARE) - Am / np.maximum(A_o + A_sum, _LEAST_SQUARE)
    return np.asarray(J + np.where(A_o > 0, change, 0).reshape(-1, 3)[pixels].T, dtype=np.float32)


def even_deviation(observations: Observations, deviation: Array, distance: Array) -> Array:
    """Return standard deviations (3, P) float32 as the root mean squares over the window, on the same surface.

    distance: (H, W) of the target, metres. Pixels whose distance differs by more than a share are another surface,
    where another part of the light arrives. Colours are shrunk by their deviations, and a gap that is shrunk more than
    the pixels around it would show again. A deviation that is not known, NaN or infinite, stays so.
    """
    variance = observations.image(deviation.astype(np.float64) ** 2)
    mean = np.empty_like(variance)
    compiled(_mean_on_surface)(variance.clip(max=_ENDLESS), np.asarray(distance, dtype=np.float32), mean)
    evened = np.sqrt(mean.reshape(-1, 3)[observations.pixels].T)
    return np.where(np.isfinite(deviation), evened, deviation)


def _mean_on_surface(variance: Array, distance: Array, mean: Array) -> None:
    """Fill mean (H, W, 3) with the means over the window, of finite values at nearly the pixel's own distance."""
    rows, columns = distance.shape
    half = _WINDOW // 2
    for y in range(rows):
        for x in range(columns):
            z, n = distance[y, x], 0
            mean[y, x] = 0.0 if z > 0 else np.nan
            if not z > 0:
                continue
            for v in range(max(0, y - half), min(rows, y + half + 1)):
                for u in range(max(0, x - half), min(columns, x + half + 1)):
                    total = variance[v, u, 0] + variance[v, u, 1] + variance[v, u, 2]
                    if abs(distance[v, u] - z) <= _SURFACE * z and math.isfinite(total):
                        n += 1
                        for c in range(3):
                            mean[y, x, c] += variance[v, u, c]
            for c in range(3):
                mean[y, x, c] = mean[y, x, c] / n if n else np.nan


def _field(there: Mask) -> Array:
    """Return (H, W): 1 inside the field of a view, gaps closed, down to 0 at its rim; images end at no rim."""
    import cv2

    closed = cv2.morphologyEx(there.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((_GAP, _GAP), np.uint8))
    inside: Any = cv2.distanceTransform(closed, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(np.clip(inside / _RIM, 0, 1), dtype=np.float32)


# Side of the window that specks take their colour from, pixels.
_AROUND = 9


def fill_pixels_without_depth(
    restoration: Restoration, view: View, prior: ImagePrior | None = None, black: Array | None = None
) -> Restoration:
    """Return a restoration with colours for the pixels without depth, and their confidence, the standard deviation.

    Specks get the mean of the colours around. Any other pixel has a distance from its surroundings, the fitted water
    and its own intensity. prior: shrinks these colours too, by the error that their guessed distance makes; black:
    (3,), what was subtracted from the other colours. Water, prior and black are of the same encoding, the fitted one.
    """
    import cv2

    z = fill_distances(view)
    holes, specks, water = z > 0, (view.depth > 0) & ~restoration.valid, restoration.water
    if water is None or not (holes | specks).any():
        return restoration
    J = filled_by_water(view, water, z)[holes].T  # (3, P)
    deviation = deviation_of_guess(J, water, z[holes])
    if black is not None:
        J = J - black[:, None]
    if prior is not None:
        J, deviation = prior.posterior(J, deviation)
    filled = np.full(view.rgb.shape, np.nan, dtype=np.float32)
    filled[holes] = converted(J.T, water.encoding or view.encoding, view.encoding)
    known = np.dstack([np.nan_to_num(restoration.image), restoration.valid])
    around = cv2.blur(known, (_AROUND, _AROUND), borderType=cv2.BORDER_CONSTANT)
    specks &= around[..., 3] > 0
    filled[specks] = around[specks, :3] / around[specks, 3:]
    if (confidence := restoration.confidence) is not None:
        confidence = confidence.copy()
        confidence[holes] = np.sqrt((deviation**2).mean(axis=0))
    return replace(restoration, filled=filled, confidence=confidence)


# -- edges ----------------------------------------------------------------------

# Half a window, of means and of sides, as a share of the image's width; at least so many pixels.
_HALF, _FEWEST = 0.005, 3

# Distances on two sides of an edge differ by at least this factor.
_STEP = 1.1

# Differences count in means up to so many typical ones.
_CLIPPED = 3.0

# A pixel is contradicted from the first chi on, and wholly from the second on.
_DOUBT, _SURE = 9.0, 25.0

# Difference of intensities that look alike; the least mean weight of the other side, and how much more than the own.
_ALIKE, _LEAST_LIKE, _MORE = 0.04, 0.2, 4.0

_FAINTEST = 1e-3

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
    import cv2

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
        spots = (share[..., 0] > 0) & ~moved
        _, spot, sizes, _ = cv2.connectedComponentsWithStats(spots.astype(np.uint8), connectivity=8)
        share[spots & (sizes[spot, cv2.CC_STAT_AREA] <= target.half**2) & target.is_wrong] = 0
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


def _alone(intensity: Array, distance: Array, water: WaterParameters) -> tuple[Array, Array]:
    """Return the colours (..., 3) that intensities alone have at distances (...,), and the transmission."""
    parameters = (column.astype(np.float32)[:, 0] for column in water.columns())
    return inverted(intensity.astype(np.float32), distance[..., None].astype(np.float32), parameters, _FAINTEST)


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
            if other_n > 0 and other > _LEAST_LIKE * other_n and other / other_n > _MORE * own / max(own_n, 1.0):
                side[y, x] = total / other
