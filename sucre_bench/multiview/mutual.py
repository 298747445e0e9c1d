"""The paper's rule of pairing, compiled: two pixels are paired if each projects onto the other (SUCRe, eq. 4 and 5).

A target pixel's centre with its depth is projected into the other view and falls (floor) into a pixel there. That
pixel's centre with its own depth is projected back and must fall (floor) into the first pixel. One gather a target
pixel decides it: no map of the other view's projections is needed. The arithmetic is float32 without reordering: equal
on every machine, and within about 1e-3 px of float64. It pairs pixels one to one and leaves gaps where one view is
closer than the other.
"""

from __future__ import annotations

import math

import numpy as np

from sucre_bench.arrays import Array, Indices
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
    found, others, distance = (
        np.empty(n, np.int32),
        np.empty(n, np.int32),
        np.empty(n, np.float32),
    )
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
                # NaN is not
                is_inside = (w > 0) & (x >= 0) & (x < columns) & (y >= 0) & (y < rows)
                u[i] = x if is_inside else none
                v[i] = y
            for i in range(m):
                landed[i] = (
                    np.int32(v[i]) * np.int32(depth.shape[1]) + np.int32(u[i])
                    if u[i] >= 0
                    else 0
                )
            for i in range(m):
                d[i] = flat[np.uint32(landed[i])]
            for i in range(m):
                x, y = u[i] + half, v[i] + half
                X = (rays[0][0] * x + rays[0][1] * y + rays[0][2]) * d[i]
                Y = (rays[1][0] * x + rays[1][1] * y + rays[1][2]) * d[i]
                w = back[2][0] * X + back[2][1] * Y + back[2][2] * d[i] + back[2][3]
                s = one / w
                x = np.floor(
                    (back[0][0] * X + back[0][1] * Y + back[0][2] * d[i] + back[0][3]) * s
                )
                y = np.floor(
                    (back[1][0] * X + back[1][1] * Y + back[1][2] * d[i] + back[1][3]) * s
                )
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
