"""The two rules of pairing, compiled: "mutual", the paper's, and "depth", which compares depths.

"mutual": two pixels are paired if each projects onto the other (SUCRe, eq. 4 and 5). A target pixel's centre with its
depth is projected into the other view and falls (floor) into a pixel there. That pixel's centre with its own depth is
projected back and must fall (floor) into the first pixel. One gather a target pixel decides it: no map of the other
view's projections is needed. The arithmetic is float32 without reordering: equal on every machine, and within about
1e-3 px of float64. It pairs pixels one to one and leaves gaps where one view is closer than the other.

"depth": another view sees a point if its depth map agrees with the point's depth. A target pixel's centre with its
depth is projected into the other view, to (x, y) at planar depth Z. The view sees it if the depth d of the pixel at
(x, y) agrees: |Z - d| <= tolerance Z. A hidden point fails this test. The colour is interpolated between the four
pixels around (x, y) if all four depths agree. Else it is the colour of the pixel at (x, y), so that no colour bleeds
over an outline. The distance is the point's own. Every visible point has an observation.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Indices, Mask
from sucre_bench.camera import Camera
from sucre_bench.machine.compute import compiled

_CHUNK = 2048

Rows = tuple[tuple[np.float32, ...], ...]


def mutual(
    points: Array,
    pixels: Indices,
    ranges: Indices,
    target: Camera,
    camera: Camera,
    depth: Array,
    to_view: Array,
    to_target: Array,
) -> tuple[Indices, Indices, Array]:
    """Return the pairs of a target and another view: pixels (M,), others (M,) int32, distance (M,) float32 metres.

    points: (3, P) float32, the target's; pixels: (P,) int32, the target pixel of each; ranges: (R, 2), starts and stops
    of the points to try; depth: (H, W) float32, the other view's; to_view, to_target: (4, 4), between the cameras'
    frames.
    """
    n = int((ranges[:, 1] - ranges[:, 0]).sum())
    found, others, distance = np.empty(n, np.int32), np.empty(n, np.int32), np.empty(n, np.float32)
    there, back = _rows(camera.K @ to_view[:3]), _rows(target.K @ to_target[:3])
    rays = _rows(np.linalg.inv(camera.K))
    size = target.size
    n = compiled(_pair)(
        points, pixels, ranges, there, depth, rays, back, size, found, others, distance
    )
    for values in (found, others, distance):
        values.resize(n, refcheck=False)  # in place: a copy would cost a third of the time
    return found, others, distance


def _rows(matrix: Array) -> Rows:
    """Return a matrix as rows of plain numbers: compiled loops hold these in registers."""
    return tuple(tuple(row) for row in matrix.astype(np.float32))


def _pair(
    points: Array,
    pixels: Indices,
    ranges: Indices,
    there: Rows,
    depth: Array,
    rays: Rows,
    back: Rows,
    size: tuple[int, int],
    found: Indices,
    others: Indices,
    distance: Array,
) -> int:
    """Fill the arrays of pairs and return their number.

    there, back: (3, 4) projections; rays: (3, 3), K^-1; size: (width, height) of the target.
    """
    # Blocks of pixels, one step at a time: all steps but the gather are then vector code, twice as fast as a loop over
    # pixels. After a failed test u is -1 or d is 0, and the remaining steps compute values that nothing uses.
    one, half, none = np.float32(1), np.float32(0.5), np.float32(-1)
    rows, columns = np.float32(depth.shape[0]), np.float32(depth.shape[1])
    wide, high = np.float32(size[0]), np.float32(size[1])
    u, v, d = (
        np.empty(_CHUNK, np.float32),
        np.empty(_CHUNK, np.float32),
        np.empty(_CHUNK, np.float32),
    )
    is_pair, z = np.empty(_CHUNK, np.bool_), np.empty(_CHUNK, np.float32)
    flat, landed = depth.reshape(-1), np.empty(_CHUNK, np.int32)
    n = 0
    for r in range(len(ranges)):
        for start in range(ranges[r, 0], ranges[r, 1], _CHUNK):
            m = min(_CHUNK, ranges[r, 1] - start)
            for i in range(m):
                X, Y, Z = points[0, start + i], points[1, start + i], points[2, start + i]
                w = there[2][0] * X + there[2][1] * Y + there[2][2] * Z + there[2][3]
                s = one / w
                x = np.floor(
                    (there[0][0] * X + there[0][1] * Y + there[0][2] * Z + there[0][3]) * s
                )
                y = np.floor(
                    (there[1][0] * X + there[1][1] * Y + there[1][2] * Z + there[1][3]) * s
                )
                is_inside = (w > 0) & (x >= 0) & (x < columns) & (y >= 0) & (y < rows)  # NaN is not
                u[i] = x if is_inside else none
                v[i] = y
            for i in range(m):
                landed[i] = (
                    np.int32(v[i]) * np.int32(depth.shape[1]) + np.int32(u[i]) if u[i] >= 0 else 0
                )
            for i in range(m):
                d[i] = flat[np.uint32(landed[i])]
            for i in range(m):
                x, y = u[i] + half, v[i] + half
                X = (rays[0][0] * x + rays[0][1] * y + rays[0][2]) * d[i]
                Y = (rays[1][0] * x + rays[1][1] * y + rays[1][2]) * d[i]
                w = back[2][0] * X + back[2][1] * Y + back[2][2] * d[i] + back[2][3]
                s = one / w
                x = np.floor((back[0][0] * X + back[0][1] * Y + back[0][2] * d[i] + back[0][3]) * s)
                y = np.floor((back[1][0] * X + back[1][1] * Y + back[1][2] * d[i] + back[1][3]) * s)
                is_inside = (
                    (u[i] >= 0)
                    & (d[i] > 0)
                    & (w > 0)
                    & (x >= 0)
                    & (x < wide)
                    & (y >= 0)
                    & (y < high)
                )
                x, y = x if is_inside else none, y if is_inside else none
                is_pair[i] = is_inside & (
                    np.int32(y) * np.int32(size[0]) + np.int32(x) == pixels[start + i]
                )
                z[i] = math.sqrt(X * X + Y * Y + d[i] * d[i])
            for i in range(m):
                # always written, counted if it is a pair: a branch would often be mispredicted
                found[n], others[n], distance[n] = pixels[start + i], landed[i], z[i]
                n += is_pair[i]
    return n


def agreeing(
    points: Array,
    pixels: Indices,
    ranges: Indices,
    camera: Camera,
    depth: Array,
    to_view: Array,
    tolerance: float,
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
    n = compiled(_agree)(*of, found, others, distance, at, smooth)
    for values in (found, others, distance, smooth):
        values.resize(n, refcheck=False)  # in place: a copy would cost a third of the time
    at.resize((n, 2), refcheck=False)
    return found, others, distance, at, smooth


def _agree(
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
            X = (
                pose[0, 0] * points[0, i]
                + pose[0, 1] * points[1, i]
                + pose[0, 2] * points[2, i]
                + pose[0, 3]
            )
            Y = (
                pose[1, 0] * points[0, i]
                + pose[1, 1] * points[1, i]
                + pose[1, 2] * points[2, i]
                + pose[1, 3]
            )
            Z = (
                pose[2, 0] * points[0, i]
                + pose[2, 1] * points[1, i]
                + pose[2, 2] * points[2, i]
                + pose[2, 3]
            )
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
            # the four pixels whose centres surround (x, y)
            left, top = (
                math.floor(x - half),
                math.floor(y - half),
            )
            agree = left >= 0 and top >= 0 and left + 1 < columns and top + 1 < rows
            if agree:
                for j in range(4):
                    d = depth[top + j // 2, left + j % 2]
                    agree = agree and d > 0 and abs(Z - d) <= most
            found[n] = pixels[i]
            others[n] = v * columns + u
            distance[n] = math.sqrt(X * X + Y * Y + Z * Z)
            at[n, 0], at[n, 1], smooth[n] = x, y, agree
            n += 1
    return n
