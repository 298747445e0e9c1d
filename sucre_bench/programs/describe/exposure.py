"""Estimates how much the exposures of views differ, without a water, from points that views see at like distances.

At like distances water takes and adds the same, so what two views i and j show of a point differs by their gains g and
by the light at its places p in the images:

    log I_j - log I_i = log g_j - log g_i + t (D(p_j) - D(p_i)) - s (z_j - z_i).

D: the terms x, y, x^2, x y, y^2 of light that falls off across the images, as that of a lamp on the camera; s: a slope
of each channel over the small differences of distance that remain. Within a pair of views the gains are constant. So t
and s follow from differences to the pair's means, and the pair's medians give the gains, by least squares over all
pairs. How well the pairs agree tells what is chance.
"""

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sucre_bench.arrays import Array, evenly
from sucre_bench.multiview.pairing import lift, visible_pixels
from sucre_bench.programs.describe.facts import Look, placed, seen_from, some_points
from sucre_bench.scene import View

# Views that are compared with others, how many others each, points of a view, and the fewest that make a pair.
_TARGETS, _PARTNERS, _POINTS, _FEWEST = 40, 8, 4_000, 100

# Depths that agree, and distances that are alike, as shares; intensities that are neither dark nor cut off.
_AGREES, _ALIKE, _LIT = 0.02, 0.15, (0.04, 0.97)

# Gains are those of points with so small a difference of distances, or of this share of the points. Their error is this
# share of the difference, since veil and colours bend the slope.
_EQUAL, _SHARE, _BENT = 0.05, 0.25, 0.3

# Gains differ if they do by this much, and by this many standard errors; the least error of a pair.
_DIFFERENT, _SURE, _LEAST_ERROR = 0.1, 4.0, 0.005

# Light falls off if it explains this share of what differs within pairs, and is darker than this somewhere.
_EXPLAINED, _DARKER = 0.3, 0.9

# Range of slopes, as optical depths. Over flat ground falling light looks like more attenuation than any water has.
_SLOPES = -1.0, 2.5

# A residual counts up to so many typical ones. Deviation of t and s beforehand.
_CLIPPED, _PRIOR = 3.0, 0.7


@dataclass(frozen=True)
class Exposure:
    """gains: (V,) of the views named, their middle being 1; error: standard error of a gain, as a share; least: light
    at the darkest places of the images over that at the brightest, 1 for even light."""

    views: tuple[str, ...]
    gains: tuple[float, ...]
    error: float
    least: float

    @property
    def falls_off(self) -> bool:
        """Whether light falls off across the images. Gains of views are not told from that."""
        return self.least < _DARKER

    @property
    def differs(self) -> bool:
        """Whether the gains differ beyond chance."""
        span = math.log(max(self.gains) / min(self.gains))
        return not self.falls_off and span > max(math.log1p(_DIFFERENT), _SURE * self.error)

    @property
    def sentence(self) -> str:
        """What it says of the views, and what methods do about it."""
        if self.falls_off:
            light = f"light falls off across the images, to {self.least:.0%} of its peak"
            return f"gains of views not known: {light}, as from a strobe on the camera; sucre removes it by itself"
        gains = f"{min(self.gains):.2f} to {max(self.gains):.2f}, ± {self.error:.1%}"
        differ = "they differ: sucre fits them by itself" if self.differs else "no difference beyond chance"
        return f"gains of {len(self.views)} views {gains}; {differ}"


class NoExposure(enum.Enum):
    """Why the exposure of views is not known."""

    FEW_VIEWS = "fewer than two views have an image, depth, a camera and a pose"
    NO_OVERLAP = "no two views have enough points in common"
    UNLIKE = "views see the same points only at unlike distances, or too dark or bright"

    @property
    def sentence(self) -> str:
        """Why it is not known."""
        return f"not known: {self.value}"


def estimate_exposure(looks: Sequence[Look]) -> Exposure | NoExposure:
    """Return the exposure of the largest group of views that see points at like distances; why not if no two do."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    views = placed([look for look in looks if look.picture is not None])
    n = len(views)
    if n < 2:
        return NoExposure.FEW_VIEWS
    pairs: list[_Pair] = []
    why = NoExposure.NO_OVERLAP
    for k in evenly(n, _TARGETS):
        most, n_before = visible_pixels(lift(views[k]), views), len(pairs)
        nearest_first = sorted((j for j in range(n) if j != k and most[j]), key=lambda j: abs(j - k))
        for j in nearest_first[: 3 * _PARTNERS]:
            pair = _pair(k, j, views)
            if isinstance(pair, _Pair):
                pairs.append(pair)
            elif pair is NoExposure.UNLIKE:
                why = pair
            if len(pairs) - n_before == _PARTNERS:
                break
    if not pairs:
        return why
    falloff, slope, least = _light(pairs)
    ends = np.array([(pair.first, pair.second) for pair in pairs]).T
    _, labels = connected_components(coo_array((np.ones(len(pairs)), tuple(ends)), shape=(n, n)), directed=False)
    group = np.flatnonzero(labels == np.bincount(labels).argmax()).tolist()  # the largest
    within = [pair for pair in pairs if pair.first in group]
    between, errors, A = np.empty(len(within)), np.empty(len(within)), np.zeros((len(within), len(group)))
    for row, pair in enumerate(within):  # log of the second view's gain over the first's, from the most equal distances
        off = np.abs(pair.columns[:, 5])
        is_equal = off <= max(_EQUAL, np.quantile(off, _SHARE))
        left = pair.ratio - (pair.columns[:, :5] @ falloff)[:, None] - pair.columns[:, 5:] * slope
        between[row] = np.median(left[is_equal])
        errors[row] = _LEAST_ERROR + _BENT * off[is_equal].mean()
        A[row, group.index(pair.second)], A[row, group.index(pair.first)] = 1, -1
    inverse = np.linalg.pinv(A / errors[:, None])
    log = inverse @ (between / errors)
    excess = len(within) - len(group) + 1
    off = (((between - A @ log) / errors) ** 2).sum() / max(excess, 1)
    gains = np.exp(log - np.median(log))
    error = float(np.sqrt((inverse**2).sum(axis=1).max() * max(1.0, off)))
    return Exposure(tuple(views[k].name for k in group), tuple(float(gain) for gain in gains), error, least)


class _Pair(NamedTuple):
    """Points that two views see. ratio: (N, 3) log I of the second over the first; terms: (N, 2, 5) of falling light in
    the two; columns: (N, 6) differences of the terms, and how much farther the second is, over the middle distance."""

    first: int
    second: int
    ratio: Array
    terms: Array
    columns: Array


def _light(pairs: Sequence[_Pair]) -> tuple[Array, Array, float]:
    """Fit falling light and slopes to what differs within pairs.

    Return the coefficients t (5,), the slope (3,) of each channel, and `least`, see `Exposure`.
    """
    x = np.concatenate([pair.columns - pair.columns.mean(axis=0) for pair in pairs])
    y = np.concatenate([pair.ratio - np.median(pair.ratio, axis=0) for pair in pairs])
    slope = _regressed(x[:, 5:], y, np.zeros((1, 3))).clip(*_SLOPES)
    before = np.median(np.abs(y - x[:, 5:] @ slope))
    for _ in range(3):
        falloff = _regressed(x[:, :5], (y - x[:, 5:] @ slope).mean(axis=1, keepdims=True), np.zeros((5, 1)))
        slope = _regressed(x[:, 5:], y - x[:, :5] @ falloff, slope).clip(*_SLOPES)
    after = np.median(np.abs(y - x[:, 5:] @ slope - x[:, :5] @ falloff))
    over = np.concatenate([pair.terms.reshape(-1, 5) for pair in pairs]) @ falloff[:, 0]
    least = float(np.exp(np.subtract(*np.percentile(over, (1, 99)))))
    if after > (1 - _EXPLAINED) * before or least > _DARKER:
        return np.zeros(5), _regressed(x[:, 5:], y, slope).clip(*_SLOPES)[0], 1.0
    return falloff[:, 0], slope[0], least


def _regressed(x: Array, y: Array, start: Array) -> Array:
    """Return the coefficients of y (N, C) on x (N, K), large residuals clipped."""
    found = start
    ridge = np.eye(x.shape[1]) * (0.05 / _PRIOR) ** 2
    for _ in range(3):
        fitted = x @ found
        typical = max(float(np.median(np.abs(y - fitted))), 1e-6)
        clipped = fitted + (y - fitted).clip(-_CLIPPED * typical, _CLIPPED * typical)
        found = np.linalg.solve(x.T @ x + ridge, x.T @ clipped)
    return found


def _pair(first: int, second: int, views: Sequence[View]) -> _Pair | NoExposure:
    view, other = views[first], views[second]
    v, u, points = some_points(view, _POINTS)
    there, at, z, depth = seen_from(other, view, points)
    is_shared = np.abs(depth - z) < _AGREES * z
    if is_shared.sum() < _FEWEST:
        return NoExposure.NO_OVERLAP
    v, u, points, there = v[is_shared], u[is_shared], points[is_shared], there[is_shared]
    column, row = at[is_shared].astype(int).T
    near, far = (np.linalg.norm(places, axis=1) for places in (points, there))
    further = 2 * (far - near) / (far + near)
    I, I_other = view.rgb[v, u], other.rgb[row, column]  # noqa: E741
    levels = np.concatenate([I, I_other], axis=1)
    seen = ((levels > _LIT[0]) & (levels < _LIT[1])).all(axis=1) & (np.abs(further) < _ALIKE)
    if seen.sum() < _FEWEST:
        return NoExposure.UNLIKE
    x, y = np.stack([one[seen, :2] / one[seen, 2:] for one in (points, there)], axis=1).transpose(2, 0, 1)
    terms = np.stack([x, y, x * x, x * y, y * y], axis=-1)
    columns = np.column_stack([terms[:, 1] - terms[:, 0], further[seen]])
    return _Pair(first, second, np.log(I_other[seen].astype(np.float64) / I[seen]), terms, columns)
