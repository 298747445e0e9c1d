"""Removes patterns in the colours that come from gaps of single views, not from the scene.

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
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Indices, Mask
from sucre_bench.machine.compute import compiled
from sucre_bench.methods.sucre.model import WaterParameters, transmission, veil
from sucre_bench.multiview.observations import Observations

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
    in_target, *others = _by_view(observations, water, observations.views.index(target))
    everywhere = (slice(None), slice(None))
    A_o, J_o = in_target.image(in_target.A, everywhere), in_target.image(in_target.J, everywhere)
    shown, whole = (_Sums.zeros(A_o.shape) for _ in range(2))
    for one in others:
        part = one.around()
        there = np.asarray((one.image(one.A, part) > 0).any(axis=-1))
        e = np.where((one.image(one.A, part) > 0) & (A_o[part] > 0), one.image(one.J, part) - J_o[part], 0)
        mean, A = _mean(e, there), _completed(one.image(one.A, part), there)
        shown.add(part, A * there[..., None], mean)
        whole.add(part, A * _field(there)[..., None], mean)
    change = np.where(A_o > 0, whole.share(A_o) - shown.share(A_o), 0)
    return np.asarray(J + change.reshape(-1, 3)[observations.pixels].T, dtype=np.float32)


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


@dataclass(frozen=True, slots=True, eq=False)
class _Shown:
    """What one view shows: flat pixels (M,) of an image of this shape, information A and colours J (3, M)."""

    shape: tuple[int, int]
    pixels: Indices
    A: Array
    J: Array

    def around(self) -> tuple[slice, slice]:
        """Return the rows and columns that hold its pixels, and a window around them."""
        row, column = np.divmod(self.pixels, self.shape[1])
        rows, columns = (slice(max(0, int(at.min()) - _WINDOW), int(at.max()) + _WINDOW + 1) for at in (row, column))
        return rows, columns

    def image(self, values: Array, part: tuple[slice, slice]) -> Array:
        """Return values (3, M) of its pixels as a part of an image (h, w, 3) float32, 0 elsewhere."""
        rows, columns = (range(*one.indices(n)) for one, n in zip(part, self.shape, strict=True))
        image = np.zeros((len(rows) * len(columns), 3), dtype=np.float32)
        row, column = np.divmod(self.pixels, self.shape[1])
        image[(row - rows.start) * len(columns) + column - columns.start] = values.T
        return image.reshape(len(rows), len(columns), 3)


@dataclass(frozen=True, slots=True, eq=False)
class _Sums:
    """Sums over views of A m and of A, (H, W, 3)."""

    Am: Array
    A: Array

    @staticmethod
    def zeros(shape: tuple[int, ...]) -> _Sums:
        return _Sums(*np.zeros((2, *shape), dtype=np.float32))

    def add(self, part: tuple[slice, slice], A: Array, mean: Array) -> None:
        self.Am[part] += A * mean
        self.A[part] += A

    def share(self, A_o: Array) -> Array:
        return np.asarray(self.Am / np.maximum(A_o + self.A, _LEAST))


def _by_view(observations: Observations, water: WaterParameters, first: int) -> Iterator[_Shown]:
    """Yield what each view shows, the view with the index `first` before all others that show anything."""
    assert observations.view is not None
    place = np.concatenate([np.arange(n, dtype=np.int32) for n, _ in observations.slots()])
    order = np.argsort(observations.view, kind="stable")
    ends = np.cumsum(np.bincount(observations.view, minlength=len(observations.views)))
    B, beta, gamma = (column.astype(np.float32) for column in water.columns())
    for v in sorted(range(len(ends)), key=lambda v: v != first):
        at = order[ends[v - 1] if v else 0 : ends[v]]
        if v != first and not len(at):  # its pixels lay in the dark of a lamp
            continue
        z = observations.distance[at]
        a = transmission(z, beta).clip(min=_DARK)
        A = a * a if observations.weight is None else observations.weight[..., at] * a * a
        I = observations.colour[:, at].astype(np.float32) * np.float32(observations.scale)  # noqa: E741
        yield _Shown(observations.shape, observations.pixels[place[at]], A, (I - veil(z, B, gamma)) / a)


def _mean(e: Array, there: Mask) -> Array:
    """Return the means of e (H, W, 3) over the window, shrunk to 0 where chance explains them."""
    n = _count(there)
    mean = _sum(e) / n
    variance = np.maximum(_sum(e * e) / n - mean**2, _LEAST)
    return np.asarray(mean * np.maximum(0, 1 - _CHANCE * variance / (n * np.maximum(mean**2, _LEAST))))


def _completed(A: Array, there: Mask) -> Array:
    """Return A (H, W, 3), in gaps the mean around them."""
    return np.where(there[..., None], A, _sum(A) / _count(there))


def _count(there: Mask) -> Array:
    return np.maximum(_sum(there.astype(np.float32)), 1)[..., None]


def _sum(image: Array) -> Array:
    import cv2

    sums: Any = cv2.boxFilter(image, -1, (_WINDOW, _WINDOW), normalize=False, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(sums)


def _field(there: Mask) -> Array:
    """Return (H, W): 1 inside the field of a view, gaps closed, down to 0 at its rim; images end at no rim."""
    import cv2

    closed = cv2.morphologyEx(there.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((_GAP, _GAP), np.uint8))
    inside: Any = cv2.distanceTransform(closed, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(np.clip(inside / _RIM, 0, 1), dtype=np.float32)
