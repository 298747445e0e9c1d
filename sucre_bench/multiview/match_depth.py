"""The rule "depth" of pairing, compiled: another view sees a point if its depth map agrees with the point's depth.

A target pixel's centre with its depth is projected into the other view, to (x, y) at planar depth Z. The view sees it
if the depth d of the pixel at (x, y) agrees: |Z - d| <= tolerance Z. A hidden point fails this test. The colour is
interpolated between the four pixels around (x, y) if all four depths agree; else it is the colour of the pixel at (x,
y), so that no colour bleeds over an outline. The distance is the point's own.

The mutual rule (match_mutual.py) pairs pixels one to one and leaves gaps where one view is closer than the other. This
rule leaves none: every visible point has an observation.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Indices, Mask
from sucre_bench.camera import Camera
from sucre_bench.machine.compile_loops import compiled


def agreeing(
    points: Array, pixels: Indices, ranges: Indices, camera: Camera, depth: Array, to_view: Array, tolerance: float
) -> tuple[Indices, Indices, Array, Array, Mask]:
    """Return the pairs of a target and another view: pixels, others, distance, at, smooth, as `Matches` has them.

    points: (3, P) float32, the target's; pixels: (P,) int32, the target pixel of each; ranges: (R, 2), starts and stops
    of the points to try; depth: (H, W) float32, the other view's; to_view: (4, 4), between the cameras' frames;
    tolerance: the greatest |Z - d| / Z.
    """
    n = int((ranges[:, 1] - ranges[:, 0]).sum())
    found, others, distance = np.empty(n, np.int32), np.empty(n, np.int32), np.empty(n, np.float32)
    at, smooth = np.empty((n, 2), np.float32), np.empty(n, np.bool_)
    pose, K = to_view[:3].astype(np.float32), camera.K.astype(np.float32)
    of = (points, pixels, ranges, pose, K, depth, np.float32(tolerance))
    n = compiled(_pair)(*of, found, others, distance, at, smooth)
    for values in (found, others, distance, smooth):
        values.resize(n, refcheck=False)  # in place: a copy would cost a third of the time
    at.resize((n, 2), refcheck=False)
    return found, others, distance, at, smooth


def _pair(
    points: Array,
    pixels: Indices,
    ranges: Indices,
    pose: Array,
    K: Array,
    depth: Array,
    tolerance: Any,
    found: Indices,
    others: Indices,
    distance: Array,
    at: Array,
    smooth: Mask,
) -> int:
    """Fill the arrays of pairs and return their number."""
    half = np.float32(0.5)
    rows, columns = depth.shape
    n = 0
    for r in range(len(ranges)):
        for i in range(ranges[r, 0], ranges[r, 1]):
            X = pose[0, 0] * points[0, i] + pose[0, 1] * points[1, i] + pose[0, 2] * points[2, i] + pose[0, 3]
            Y = pose[1, 0] * points[0, i] + pose[1, 1] * points[1, i] + pose[1, 2] * points[2, i] + pose[1, 3]
            Z = pose[2, 0] * points[0, i] + pose[2, 1] * points[1, i] + pose[2, 2] * points[2, i] + pose[2, 3]
            if not Z > 0:  # behind the camera; NaN
                continue
            x = (K[0, 0] * X + K[0, 1] * Y) / Z + K[0, 2]
            y = (K[1, 0] * X + K[1, 1] * Y) / Z + K[1, 2]
            if not (x >= 0 and x < columns and y >= 0 and y < rows):
                continue
            u, v = int(x), int(y)
            most = tolerance * Z
            d = depth[v, u]
            if not (d > 0 and abs(Z - d) <= most):
                continue
            left, top = math.floor(x - half), math.floor(y - half)  # the four pixels whose centres surround (x, y)
            agree = left >= 0 and top >= 0 and left + 1 < columns and top + 1 < rows
            if agree:
                for j in range(4):
                    d = depth[top + j // 2, left + j % 2]
                    agree = agree and d > 0 and abs(Z - d) <= most
            found[n], others[n] = pixels[i], v * columns + u
            distance[n] = math.sqrt(X * X + Y * Y + Z * Z)
            at[n, 0], at[n, 1], smooth[n] = x, y, agree
            n += 1
    return n
