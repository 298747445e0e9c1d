"""Removes patterns in the colours that come from gaps of single views, and colours pixels without depth.

Views of a point never agree fully: light, exposure and the model's errors differ. A pixel that one view misses, between
pixels that it shows, then has another colour than they. Pairs of pixels leave such gaps in dots and lines wherever
scales differ, and a step where the field of a view ends.

Let e be how far the colour that a view v alone gives is from the colour that the target's own intensity gives. Its mean
m_v over a window is what v changes there systematically. With a view's information A_v = w a^2, and the target's own
A_o,

    s  = sum_shown A_v m_v / (A_o + sum_shown A_v)               is what the views have changed at a pixel, and
    s* = sum f_v A_v m_v / (A_o + sum f_v A_v)                   what they would have, had none of them a gap;

f_v is 1 inside the field of view v and falls to 0 at its rim. The result is J + s* - s. Detail and noise stay as they
are: only means over windows are added. Where views agree, m_v is no larger than chance and counts as 0.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Indices, Mask
from sucre_bench.imaging.encoding import converted
from sucre_bench.imaging.fill import deviation_of_guess, fill_distances, filled_by_water
from sucre_bench.machine.compute import compiled
from sucre_bench.methods.sucre.model import WaterParameters, inverted
from sucre_bench.methods.sucre.refine_noise import ImagePrior, box_sum
from sucre_bench.multiview.observations import Observations
from sucre_bench.scene import Restoration, View

# Side of the window of a mean, the largest gap that is closed, and the width of a field's rim, pixels.
_WINDOW, _GAP, _RIM = 9, 7, 12.0

# A mean counts as far as its square exceeds so many times the square of its standard error.
_CHANCE = 4.0

# The least transmission and the least square of a number that is divided by.
_DARK, _LEAST = 1e-6, 1e-12

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
        variance = np.maximum(box_sum(e * e, _WINDOW // 2) / n - mean**2, _LEAST)
        mean *= np.maximum(0, 1 - _CHANCE * variance / (n * np.maximum(mean**2, _LEAST)))  # 0 where it may be chance
        whole = np.where(there[..., None], A, box_sum(A, _WINDOW // 2) / n) * _field(there)[..., None]
        for total, added in ((Am, A * mean), (A_sum, A), (Am_whole, whole * mean), (A_whole, whole)):
            total[part] += added
    change = Am_whole / np.maximum(A_o + A_whole, _LEAST) - Am / np.maximum(A_o + A_sum, _LEAST)
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
            z, n, red, green, blue = distance[y, x], 0, 0.0, 0.0, 0.0
            mean[y, x] = np.nan
            if not z > 0:
                continue
            for v in range(max(0, y - half), min(rows, y + half + 1)):
                for u in range(max(0, x - half), min(columns, x + half + 1)):
                    total = variance[v, u, 0] + variance[v, u, 1] + variance[v, u, 2]
                    if abs(distance[v, u] - z) <= _SURFACE * z and math.isfinite(total):
                        n += 1
                        red += variance[v, u, 0]
                        green += variance[v, u, 1]
                        blue += variance[v, u, 2]
            if n:
                mean[y, x, 0], mean[y, x, 1], mean[y, x, 2] = red / n, green / n, blue / n


def _field(there: Mask) -> Array:
    """Return (H, W): 1 inside the field of a view, gaps closed, down to 0 at its rim; images end at no rim."""
    import cv2

    closed = cv2.morphologyEx(there.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((_GAP, _GAP), np.uint8))
    inside: Any = cv2.distanceTransform(closed, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(np.clip(inside / _RIM, 0, 1), dtype=np.float32)


def fill_pixels_without_depth(
    restoration: Restoration, view: View, prior: ImagePrior | None = None, black: Array | None = None
) -> Restoration:
    """Return a restoration with colours for the pixels without depth, and their confidence, the standard deviation.

    Such a pixel has a distance from its surroundings, the fitted water and its own intensity. prior: shrinks these
    colours too, by the error that their guessed distance makes; black: (3,), what was subtracted from the other
    colours. Water, prior and black are of the same encoding, the fitted one.
    """
    z = fill_distances(view)
    holes, water = z > 0, restoration.water
    if water is None or not holes.any():
        return restoration
    J = filled_by_water(view, water, z)[holes].T  # (3, P)
    deviation = deviation_of_guess(J, water, z[holes])
    if black is not None:
        J = J - black[:, None]
    if prior is not None:
        J, deviation = prior.posterior(J, deviation)
    filled = np.full(view.rgb.shape, np.nan, dtype=np.float32)
    filled[holes] = converted(J.T, water.encoding or view.encoding, view.encoding)
    if (confidence := restoration.confidence) is not None:
        confidence = confidence.copy()
        confidence[holes] = np.sqrt((deviation**2).mean(axis=0))
    return replace(restoration, filled=filled, confidence=confidence)
