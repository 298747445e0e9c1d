"""Colours and rays of a view's matches."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array, Indices, Mask
from sucre_bench.camera import Camera
from sucre_bench.imaging.encoding import srgb_decode
from sucre_bench.imaging.once import locked
from sucre_bench.machine.compile_loops import compiled
from sucre_bench.multiview.observations import compact
from sucre_bench.multiview.pairing import Matches


def colours_at(matches: Matches, rgb: npt.NDArray[Any], decode: bool) -> tuple[Matches, npt.NDArray[Any]]:
    """Return the matches with a finite colour, and their colours (M, 3), uint8, uint16 or float32 (see `compact`).

    rgb: (H, W, 3) float32 in [0, 1], the view's; decode: convert sRGB to linear light, as uint16. Instead, for matches
    of pixels and without `decode`, rgb may hold the levels as uint8.
    """
    if rgb.dtype == np.uint8:
        return matches, _gathered(rgb, matches.others)
    nearest = rgb.reshape(-1, 3)[matches.others]
    if matches.at is None or matches.smooth is None:
        colours = srgb_decode(nearest) if decode else nearest
    else:  # in linear light if `decode`
        colours = _interpolated(srgb_decode(rgb) if decode else rgb, matches.others, matches.at, matches.smooth)
    if not np.isfinite(colours).all():
        which = np.asarray(np.isfinite(colours).all(axis=-1))
        colours, nearest, matches = colours[which], nearest[which], matches.only(which)
    if decode:
        return matches, _levels(colours, np.uint16)
    if matches.at is None:
        return matches, compact(colours)
    source = compact(nearest).dtype.type
    return matches, colours if source is np.float32 else _levels(colours, source)


def _gathered(levels: npt.NDArray[Any], others: Indices) -> npt.NDArray[Any]:
    """The levels (M, 3) of pixels of an image (H, W, 3)."""
    colours = np.empty((len(others), 3), levels.dtype)
    compiled(_gather)(locked(np.ascontiguousarray(levels).reshape(-1, 3)), locked(others), colours)
    return colours


def _gather(levels: npt.NDArray[Any], others: Indices, colours: npt.NDArray[Any]) -> None:
    for i in range(len(others)):
        pixel = others[i]
        colours[i, 0], colours[i, 1], colours[i, 2] = levels[pixel, 0], levels[pixel, 1], levels[pixel, 2]


def _levels(colours: Array, kind: type[np.unsignedinteger[Any]]) -> npt.NDArray[Any]:
    full = np.iinfo(kind).max
    levels = colours * np.float32(full)
    np.rint(levels, out=levels)
    return np.clip(levels, 0, full, out=levels).astype(kind)


def _interpolated(rgb: Array, others: Indices, at: Array, smooth: Mask) -> Array:
    """The colours (M, 3) float32 of an image (H, W, 3): bilinear at `at` where `smooth`, else of the pixel `others`.

    If one of the four colours is not finite, the pixel `others` counts, too.
    """
    colours = np.empty((len(others), 3), np.float32)
    compiled(_interpolate)(np.ascontiguousarray(rgb, np.float32), others, at, smooth, colours)
    return colours


def _interpolate(rgb: Array, others: Indices, at: Array, smooth: Mask, colours: Array) -> None:
    half, one = np.float32(0.5), np.float32(1)
    columns = rgb.shape[1]
    for i in range(len(others)):
        nearest = rgb[others[i] // columns, others[i] % columns]
        x, y = at[i, 0] - half, at[i, 1] - half
        u, v = math.floor(x), math.floor(y)
        s, t = x - np.float32(u), y - np.float32(v)
        for c in range(3):
            colours[i, c] = nearest[c]
            if smooth[i]:
                above = (one - s) * rgb[v, u, c] + s * rgb[v, u + 1, c]
                below = (one - s) * rgb[v + 1, u, c] + s * rgb[v + 1, u + 1, c]
                mixed = (one - t) * above + t * below
                if math.isfinite(mixed):
                    colours[i, c] = mixed


def rays_at(matches: Matches, camera: Camera) -> Array:
    """Return the rays (2, M) float32 to the matched points: x / z and y / z in the frame of the view's camera."""
    at = matches.at
    if at is None:
        at = np.stack([matches.others % camera.width, matches.others // camera.width], axis=1) + 0.5  # (M, 2)
    K_inv = np.linalg.inv(camera.K)
    return np.asarray(K_inv[:2, :2] @ at.T + K_inv[:2, 2:], dtype=np.float32)
