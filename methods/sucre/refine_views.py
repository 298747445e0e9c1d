"""Corrects colours where single views have gaps, and at edges, where other views do not show what the target shows.

**Gaps.** Views of a point never agree fully: light, exposure and the model's errors differ. A pixel that one view
misses, between pixels that it shows, then has another colour than they. Pairs of pixels leave such gaps in dots and
lines wherever scales differ, and a step where the field of a view ends.

Let e be how far the colour that a view v alone gives is from the colour that the target's own intensity gives. Its mean
m_v over a window is what v changes there systematically. With a view's information A_v = w a^2, and the target's own
A_o,

    s  = sum_shown A_v m_v / (A_o + sum_shown A_v)               is what the views have changed at a pixel, and
    s* = sum f_v A_v m_v / (A_o + sum f_v A_v)                   what they would have, had none of them a gap;

f_v is 1 inside the field of view v and falls to 0 at its rim. The result is J + d, d being s* - s less its own mean
over the window: the pattern goes, and the colour of a place stays what all its views say. Detail and noise stay as
they are. Where views agree, m_v is no larger than chance and counts as 0.

**Edges.** Depth maps of real dives are off by some pixels at outlines. A pixel of a near board then has the distance of
the ground behind it, and pairs with ground in other views. Its colour becomes a mixture, removed through the wrong
length of water: a bright or cyan fringe. Wrong by one pixel, pairs do the same at edges of texture.

The target's own intensity I is what the picture shows. A pixel is *contradicted* if its own colour J_o = (I - b) / a
differs from J by much more than noise explains, compared with how much they differ around it (light differs between
views, which is no contradiction):

    e = (J_o - J) - mean of the same over the window,    chi = (e a / s)^2, mean over channels,

where s is the typical e a of pixels at a similar distance, from its median.

1. Specks stay as the other views show them: a few contradicted pixels side by side, whose own observation robust
   weights call wrong while two others agree. Marine snow looks like that.
2. Other contradicted pixels take their own detail: J + e, faded in between two thresholds of chi. One observation
   tells no more than all of them, so their standard deviation does not fall.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Indices, Mask
from sucre_bench.imaging.encoding import converted
from sucre_bench.imaging.fill import deviation_of_guess, fill_distances, filled_by_water
from sucre_bench.methods.sucre.model import WaterParameters, inverted
from sucre_bench.methods.sucre.observed import Observed
from sucre_bench.methods.sucre.refine_noise import (
    SPREAD,
    SPREAD_LINEAR,
    ImagePrior,
    box_sum,
    calibrated,
    followed,
    prior_of,
    specks_of,
)
from sucre_bench.methods.sucre.robust import WRONG, trusted
from sucre_bench.methods.sucre.solution import Solution
from sucre_bench.multiview.observations import Observations
from sucre_bench.scene import Restoration, View

# Side of the window of a mean, the largest gap that is closed, and the width of a field's rim, pixels.
_WINDOW = 9
_GAP = 7
_RIM = 12.0

# A mean counts as far as its square exceeds so many times the square of its standard error.
_CHANCE = 4.0

# The least transmission and the least square of a number that is divided by.
_DARK = 1e-6
_LEAST_SQUARE = 1e-12


def evened(observations: Observations, J: Array, water: WaterParameters, target: str) -> Array:
    """Return the colours without the pattern of gaps, (3, P) float32.

    observations: with `view`; J: (3, P), their colours in this water; target: the name of the restored view. Pixels
    that the target itself does not show stay as they are.
    """
    assert observations.view is not None, "observe with views"
    if target not in observations.views:
        return J
    shape, pixels = observations.shape, observations.pixels
    place = observations.place
    order = np.argsort(observations.view, kind="stable")
    ends = np.cumsum(np.bincount(observations.view, minlength=len(observations.views)))
    parameters = [column.astype(np.float32) for column in water.columns()]

    def shown_by(v: int) -> tuple[Indices, Array, Array]:
        """The pixels that a view shows, and images (H, W, 3) of their information A and colours J, 0 elsewhere."""
        at = order[ends[v - 1] if v else 0 : ends[v]]
        I = observations.colour[:, at].astype(np.float32) * np.float32(observations.scale)
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
        part = tuple(
            slice(max(0, int(at.min()) - _WINDOW), int(at.max()) + _WINDOW + 1) for at in sides
        )
        A = A[part]
        there = np.asarray((A > 0).any(axis=-1))
        e = np.where((A > 0) & (A_o[part] > 0), J_v[part] - J_o[part], 0)
        n = np.maximum(box_sum(there.astype(np.float32), _WINDOW // 2), 1)[..., None]
        mean = box_sum(e, _WINDOW // 2) / n
        variance = np.maximum(box_sum(e * e, _WINDOW // 2) / n - mean**2, _LEAST_SQUARE)
        mean *= np.maximum(0, 1 - _CHANCE * variance / (n * np.maximum(mean**2, _LEAST_SQUARE)))
        whole = (
            np.where(there[..., None], A, box_sum(A, _WINDOW // 2) / n)
            * _field(there)[..., None]
        )
        for total, added in (
            (Am, A * mean),
            (A_sum, A),
            (Am_whole, whole * mean),
            (A_whole, whole),
        ):
            total[part] += added
    change = Am_whole / np.maximum(A_o + A_whole, _LEAST_SQUARE) - Am / np.maximum(
        A_o + A_sum, _LEAST_SQUARE
    )
    is_own = A_o > 0
    change[~is_own] = 0
    n = np.maximum(box_sum(is_own.astype(np.float32), _WINDOW // 2), 1)
    change -= np.where(is_own, box_sum(change, _WINDOW // 2) / n, 0)
    return np.asarray(J + change.reshape(-1, 3)[pixels].T, dtype=np.float32)


def _field(there: Mask) -> Array:
    """Return (H, W): 1 inside the field of a view, gaps closed, down to 0 at its rim; images end at no rim."""
    import cv2

    closed = cv2.morphologyEx(
        there.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((_GAP, _GAP), np.uint8)
    )
    inside: Any = cv2.distanceTransform(closed, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(np.clip(inside / _RIM, 0, 1), dtype=np.float32)


# -- edges ----------------------------------------------------------------------

# Half a window, of means and of sides, as a share of the image's width, and at least so many pixels.
_HALF = 0.005
_FEWEST = 3

# Differences count in means up to so many typical ones.
_CLIPPED = 3.0

# A pixel is contradicted from the first chi on, and wholly from the second on.
_DOUBT = 9.0
_SURE = 25.0

_FAINTEST = 1e-3

# Pixels that typical differences are taken from, and entries of their table over distance.
_SAMPLE = 200_000
_FINE = 1000

# Sum of the robust weights of other views that agree.
_AGREE = 1.5

# Classes of distance, the median of the square of a standard normal number, and the least noise (8 bits).
_CLASSES = 12
_MEDIAN_OF_SQUARE = 0.455
_LEAST_NOISE = 2e-3


def corrected_edges(
    intensity: Array,
    z: Array,
    J: Array,
    deviation: Array,
    water: WaterParameters,
    is_wrong: Mask | None = None,
) -> tuple[Array, Array]:
    """Return colours and standard deviations (H, W, 3) float32 with those of contradicted pixels corrected.

    intensity: (H, W, 3) of the target, as fitted; z: (H, W) metres, 0 where unknown; J, deviation: NaN without depth;
    is_wrong: (H, W) pixels that the other views agree to contradict, where robust weights tell. A corrected colour has
    the deviation of a single observation, as far as it is one.
    """
    import cv2

    known = np.isfinite(J + intensity).all(axis=-1) & (z > 0)
    half = max(_FEWEST, round(_HALF * z.shape[1]))
    parameters = (column.astype(np.float32)[:, 0] for column in water.columns())
    own, a = inverted(
        intensity.astype(np.float32), z[..., None].astype(np.float32), parameters, _FAINTEST
    )
    difference = np.where(known[..., None], own - J, np.float32(0))
    most = _CLIPPED * _deviation(difference, a, z, known)
    n = np.maximum(box_sum(known.astype(np.float32), half), 1)[..., None]
    e = difference - box_sum(difference.clip(-most, most).astype(np.float32), half) / n
    e[~known] = 0
    noise = _deviation(e, a, z, known)
    chi = ((e / np.maximum(noise, _LEAST_NOISE / a)) ** 2).mean(axis=-1)
    share = np.where(known, np.clip((chi - _DOUBT) / (_SURE - _DOUBT), 0, 1), 0)[..., None]
    if is_wrong is not None:
        spots = share[..., 0] > 0
        _, spot, sizes, _ = cv2.connectedComponentsWithStats(
            spots.astype(np.uint8), connectivity=8
        )
        share[spots & (sizes[spot, cv2.CC_STAT_AREA] <= half**2) & is_wrong] = 0
    # deviations may be infinite
    rest = np.multiply(1 - share, deviation, out=np.zeros_like(noise), where=share < 1)
    left = np.sqrt(rest**2 + (share * noise) ** 2)
    # one tells no more than all of them
    left = np.maximum(left, np.where(np.isfinite(deviation), deviation, 0))
    return (J + share * e).astype(np.float32), np.where(share > 0, left, deviation).astype(
        np.float32
    )


def wrong_in_target(observations: Observations, v: Array, target: str) -> Mask:
    """Return (H, W) the pixels whose own observation is wrong while at least two others agree.

    observations: with `view`; v: (N,), the trust in them; target: name of the view.
    """
    assert observations.view is not None, "observe with views"
    place = observations.place
    is_own = observations.view == observations.views.index(target)
    others = np.bincount(place[~is_own], v[~is_own], len(observations.pixels))
    own = place[is_own]
    wrong = np.zeros(observations.shape, dtype=bool)
    wrong.ravel()[observations.pixels[own[(v[is_own] < WRONG) & (others[own] > _AGREE)]]] = True
    return wrong


def _deviation(e: Array, a: Array, distance: Array, known: Mask) -> Array:
    """Return the typical size (H, W, 3) of differences e of colours: that of e a at similar distances, over a."""
    places = np.flatnonzero(known)
    few = places[:: max(1, len(places) // _SAMPLE)]
    few = few[np.argsort(distance.ravel()[few], kind="stable")]
    z = distance.ravel()[few]
    squares = (e.reshape(-1, 3)[few] * a.reshape(-1, 3)[few]) ** 2
    classes = [part for part in np.array_split(np.arange(len(z)), _CLASSES) if len(part)]
    middle = [z[part].mean() for part in classes]
    typical = np.sqrt(
        [np.median(squares[part], axis=0) / _MEDIAN_OF_SQUARE for part in classes]
    )
    if not classes:
        return np.ones_like(a)
    fine = np.linspace(middle[0], middle[-1], _FINE)  # a table: distances are many
    table = np.stack(
        [np.interp(fine, middle, of_channel) for of_channel in typical.T], axis=-1
    ).astype(np.float32)
    step = max((middle[-1] - middle[0]) / (_FINE - 1), 1e-9)
    return np.asarray(
        table[((distance - middle[0]) / step).clip(0, _FINE - 1).astype(np.int32)] / a
    )


# -- all of it ----------------------------------------------------------------------


def refined(seen: Observed, solution: Solution) -> tuple[Solution, ImagePrior | None]:
    """Return colours without specks and, with refine=true, with less noise and without gaps; and what shrank them."""
    options = seen.options
    linear = seen.encoding == "linear"
    prior = None
    if not solution.is_photograph:
        if options.colours == "multi_view" and (solution.trust is not None or options.refine):
            solution = calibrated(seen.observations, solution)
            solution = _of_many_views(seen, solution) if options.refine else solution
        if options.robust:
            # colours that no surface has are unknown: none at all, or for the prior to guess
            is_speck = specks_of(solution.J, solution.deviation, linear=linear)
            J = (
                solution.J
                if options.refine
                else np.where(is_speck, np.float32(np.nan), solution.J)
            )
            unknown = np.float32(np.inf if options.refine else np.nan)
            solution = replace(
                solution, J=J, deviation=np.where(is_speck, unknown, solution.deviation)
            )
    if options.refine and not solution.is_photograph:
        prior = prior_of(solution.J, solution.deviation, SPREAD_LINEAR if linear else SPREAD)
    if prior is not None:
        J, deviation = prior.posterior(solution.J, solution.deviation)
        solution = replace(solution, J=J, deviation=deviation)
    return solution, prior


def _of_many_views(seen: Observed, solution: Solution) -> Solution:
    """Return colours without gaps, with the edges that the image shows, and with less noise in two channels."""
    observations = seen.observations
    view = seen.view
    is_wrong = None
    if solution.trust is not None:
        is_wrong = wrong_in_target(observations, solution.trust, view.name)
        observations = trusted(observations, solution.trust)

    def by_pixel(image: Array) -> Array:
        return image.reshape(-1, 3)[observations.pixels].T

    J = evened(observations, solution.J, solution.water, view.name)
    deviation = solution.deviation
    if seen.options.robust is not True:
        images = observations.image(J), observations.image(deviation)
        images = corrected_edges(
            seen.intensities, view.distance, *images, solution.water, is_wrong
        )
        J, deviation = map(by_pixel, images)
    J, deviation = map(by_pixel, followed(observations.image(J), observations.image(deviation)))
    return replace(solution, J=J, deviation=deviation)


# Side of the window that specks take their colour from, pixels.
_AROUND = 9


def fill_pixels_without_depth(
    restoration: Restoration, view: View, prior: ImagePrior | None = None
) -> Restoration:
    """Return a restoration with colours for the pixels without depth, and their confidence, the standard deviation.

    Specks get the mean of the colours around. Any other pixel has a distance from its surroundings, the fitted water
    and its own intensity. prior: shrinks them, by the error that their guessed distance makes.
    """
    import cv2

    z = fill_distances(view)
    holes = z > 0
    specks = (view.depth > 0) & ~restoration.valid
    water = restoration.water
    if water is None or not (holes | specks).any():
        return restoration
    J = filled_by_water(view, water, z)[holes].T  # (3, P)
    deviation = deviation_of_guess(J, water, z[holes])
    if prior is not None:
        J, deviation = prior.posterior(J, deviation)
    filled = np.full(view.rgb.shape, np.nan, dtype=np.float32)
    filled[holes] = converted(J.T, water.encoding or view.encoding, view.encoding)
    known = np.dstack([np.nan_to_num(restoration.image), restoration.valid])
    around = cv2.blur(known, (_AROUND, _AROUND), borderType=cv2.BORDER_CONSTANT)
    specks &= around[..., 3] > 0
    filled[specks] = around[specks, :3] / around[specks, 3:]
    confidence = restoration.confidence
    if confidence is not None:
        confidence = confidence.copy()
        confidence[holes] = np.sqrt((deviation**2).mean(axis=0))
    return replace(restoration, filled=filled, confidence=confidence)
