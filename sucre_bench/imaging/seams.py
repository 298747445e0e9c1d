"""Seams of a picture: steps along a line that neither the photograph nor its distances explain.

A restoration that is a smooth function of a pixel's colour and distance has no seam. If the photograph is smooth at a
place, the restoration is smooth there, too. One that is put together from other photographs may step where its sources
change. To tell such steps from the photograph's own edges, which a restoration may well make stronger, and from noise:

1. Both pictures, each channel brought to [0, 1] at its percentiles 1 and 99, are reduced to 512 pixels, a hole where
   most is hole.
2. At each pixel two strips of 31 x 5 pixels that meet there are compared, for six directions of the line between them.
   The step of a quantity q, d q, is the difference of its means over the strips. Means over 155 pixels know little of
   noise and fine texture, and much of an edge that is as long as a strip.
3. Looked at is where the photograph I does not visibly step: |d I| < 0.05, a twentieth of its contrast, in all
   channels. Distances must differ by less than 10 %, or one thing end before another. Strips must be four fifths
   full.
4. What a smooth function of colour I and log distance s can do to a step is linear in d I, d s and I d s. In each
   eighth of the distances the coefficients are found by least squares over all places and directions. Seams are too few
   to disturb the fit. The excess u is the rest of the picture's step d S.
5. It is a seam where |u| and |d S| exceed 0.05, too, and |u| exceeds 5 times what is typical of that distance (1.4826
   medians of |u|, a standard deviation if it were noise), in any channel.

Why not neighbouring pixels? Of pairs alike in colour and distance, restorers of single images make 60 % jump by a tenth
of the contrast in turbid water (noise, which they amplify), and stitching 7 %.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array, Mask
from sucre_bench.imaging.display import stretch

# Pixels: of the longer side, of a strip along and across; how many directions; how full a strip must be.
_SIDE = 512
_LONG = 31
_WIDE = 5
_DIRECTIONS = 6
_FULL = 0.8

# Relative difference of the strips' distances; how many groups of distances, and the fewest places of one.
_SAME_SURFACE = 0.1
_GROUPS = 8
_FEWEST = 1000

# From where on a step is visible, in units of the picture's contrast.
VISIBLE = 0.05
# From where on it is unusual, in typical steps.
_UNUSUAL = 5.0

# Places the coefficients are found on, of each direction.
_SAMPLE = 1 << 14


@dataclass(frozen=True, slots=True, eq=False)
class Seams:
    """The picture as it was looked at, (h, w), at most 512 pixels long."""

    excess: Array
    """The largest |u| of any direction and channel (where |d S| is less, that), (h, w) float32; NaN where none was
    looked at."""

    is_seam: Mask
    """Shape (h, w), bool."""

    picture: Array
    """Brought to [0, 1], (h, w, 3) float32; NaN where it has holes."""


@dataclass(frozen=True, slots=True, eq=False)
class _Steps:
    """Steps across one direction, at the places looked at."""

    at: npt.NDArray[np.int64]
    """Flat indices into the picture, (M,)."""

    d: Array
    """Steps of S, I and s, (M, 7)."""

    I: Array
    """Between the strips, (M, 3)."""

    @property
    def terms(self) -> Array:
        """What a function of colour and distance may depend on, (M, 7)."""
        d_s = self.d[:, 6:]
        return np.concatenate([self.d[:, 3:6], d_s, self.I * d_s], axis=1)


def find_seams(picture: Array, photograph: Array, distance: Array | None = None) -> Seams:
    """Look for seams in a picture made of a photograph.

    picture, photograph: (H, W, 3), [0, 1], gamma-encoded, NaN where the picture has no colour; distance: (H, W) metres,
    0 where unknown: there, nothing is looked at; None to look everywhere, whatever the distances.
    """
    distance = np.ones(picture.shape[:2]) if distance is None else distance
    known: Mask = (
        np.isfinite(picture).all(axis=-1)
        & np.isfinite(photograph).all(axis=-1)
        & (distance > 0)
    )
    log_distance = np.log(np.where(known, distance, 1))
    planes = np.dstack(
        [_contrast(picture, known), _contrast(photograph, known), log_distance]
    ).astype(np.float32)
    planes, known = _reduced(planes, known)
    found = list(_steps(planes, known))
    excess, unusual = np.full(known.size, -np.inf, np.float32), np.zeros(known.size, dtype=bool)
    s = planes[..., 6].ravel()
    fits = (
        _fits(found, s, np.quantile(s[known.ravel()], np.arange(1, _GROUPS) / _GROUPS))
        if found
        else []
    )
    for steps, (u, typical) in zip(found, fits, strict=True):
        jump = np.minimum(np.abs(u), np.abs(steps.d[:, :3]))
        is_one = (jump > VISIBLE) & (np.abs(u) > _UNUSUAL * typical)
        np.maximum.at(excess, steps.at, jump.max(axis=1))
        np.logical_or.at(unusual, steps.at, is_one.any(axis=1))
    excess[np.isinf(excess)] = np.nan
    shown = np.where(known[..., None], planes[..., :3], np.nan)
    return Seams(excess.reshape(known.shape), unusual.reshape(known.shape), shown)


def _contrast(image: Array, known: Mask) -> Array:
    """Each channel from its percentile 1 to 99 of the pixels known, 0 elsewhere."""
    full = np.zeros(image.shape, dtype=np.float32)
    if known.any():
        full[known] = stretch(image[known].astype(np.float64))
    return full


def _reduced(planes: Array, known: Mask) -> tuple[Array, Mask]:
    """Means over the known pixels, (h, w, C), and where they are most."""
    import cv2

    share = _SIDE / max(known.shape)
    if share >= 1:
        return planes * known[..., None], known
    size = (max(1, round(known.shape[1] * share)), max(1, round(known.shape[0] * share)))
    weight = cv2.resize(known.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    sums = [
        cv2.resize(plane * known, size, interpolation=cv2.INTER_AREA)
        for plane in np.moveaxis(planes, -1, 0)
    ]
    kept = weight > 0.5
    return np.dstack(sums) / np.where(kept, weight, 1)[..., None] * kept[..., None], np.asarray(
        kept
    )


def _steps(planes: Array, known: Mask) -> Iterator[_Steps]:
    """The steps across lines of every direction: the picture is turned, and looked at for upright lines.

    planes: (h, w, 7) of S, I and s, 0 where not known.
    """
    import cv2

    height, width = known.shape
    side = int(np.ceil(np.hypot(height, width))) + 2 * _WIDE
    places = np.arange(known.size, dtype=np.float32).reshape(known.shape)  # exact below 2^24
    stack = [*np.moveaxis(planes, -1, 0), known.astype(np.float32)]
    # from the line's pixel, which is in neither strip, to the middle of a strip
    reach = (_WIDE + 1) // 2
    for k in range(_DIRECTIONS):
        turn = cv2.getRotationMatrix2D(
            ((width - 1) / 2, (height - 1) / 2), 180 * k / _DIRECTIONS, 1
        )
        turn[:, 2] += (side - width) / 2, (side - height) / 2

        def turned(plane: Array, outside: float, turn: Any = turn) -> Array:
            return np.asarray(
                cv2.warpAffine(
                    plane, turn, (side, side), flags=cv2.INTER_NEAREST, borderValue=outside
                )
            )

        means = [
            cv2.boxFilter(turned(plane, 0), -1, (_WIDE, _LONG), borderType=cv2.BORDER_CONSTANT)
            for plane in stack
        ]
        full = means.pop()
        strips = np.dstack(means) / np.maximum(full, 1e-6)[..., None]
        at = turned(places, -1)[:, reach:-reach]
        right, left = strips[:, 2 * reach :], strips[:, : -2 * reach]
        is_full = (full[:, 2 * reach :] >= _FULL) & (full[:, : -2 * reach] >= _FULL)
        step = right - left
        alike = (np.abs(step[..., 3:6]) < VISIBLE).all(axis=-1) & (
            np.abs(step[..., 6]) < _SAME_SURFACE
        )
        kept = is_full & alike & (at >= 0)
        kept[kept] = known.ravel()[at[kept].astype(np.int64)]
        if kept.any():
            middle = (right[kept][:, 3:6] + left[kept][:, 3:6]) / 2
            yield _Steps(at[kept].astype(np.int64), step[kept], middle)


def _fits(found: list[_Steps], s: Array, limits: Array) -> list[tuple[Array, Array]]:
    """Each direction's u (M, 3), and the typical |u| (M, 3) of the place's group of distances."""
    few = [slice(None, None, max(1, len(steps.at) // _SAMPLE)) for steps in found]
    group = np.concatenate(
        [np.digitize(s[steps.at[part]], limits) for steps, part in zip(found, few, strict=True)]
    )
    terms = np.concatenate(
        [steps.terms[part] for steps, part in zip(found, few, strict=True)]
    ).astype(np.float64)
    d_S = np.concatenate(
        [steps.d[part, :3] for steps, part in zip(found, few, strict=True)]
    ).astype(np.float64)
    everywhere = _fit(terms, d_S)
    members = [group == k for k in range(_GROUPS)]
    by_group = [
        _fit(terms[k], d_S[k]) if np.count_nonzero(k) >= _FEWEST else everywhere
        for k in members
    ]
    coefficients, typical = (np.stack(parts) for parts in zip(*by_group, strict=True))
    return [
        _excess(steps, np.digitize(s[steps.at], limits), coefficients, typical)
        for steps in found
    ]


def _fit(terms: Array, d_S: Array) -> tuple[Array, Array]:
    """Coefficients (7, 3), the smallest of equally good ones, and the typical |u| (3,) that they leave."""
    coefficients = np.linalg.pinv(terms.T @ terms, rcond=1e-10, hermitian=True) @ (
        terms.T @ d_S
    )
    return coefficients, 1.4826 * np.median(np.abs(d_S - terms @ coefficients), axis=0)


def _excess(
    steps: _Steps, group: npt.NDArray[np.integer[Any]], coefficients: Array, typical: Array
) -> tuple[Array, Array]:
    u = steps.d[:, :3].copy()
    terms = steps.terms
    coefficients = coefficients.astype(np.float32)
    for k in range(len(coefficients)):
        members = group == k
        u[members] -= terms[members] @ coefficients[k]
    return u, typical[group]
