"""Casts rays at the made seabed and its boards: which surface each meets first, how far away, and how it is turned.

The ground is a grid of heights with two triangles a cell. Seen from above, a ray crosses the grid's lines and the
diagonals of its cells. Between two crossings it is over one triangle, so one subtraction says whether it goes below.
Blocks of cells that lie lower than the ray are left in one step.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.datasets.demo.seabed import Board, Terrain
from sucre_bench.machine.compute import compiled, usable_cores

_BLOCK = 16  # cells along each side
_BEYOND = 1e-9  # of a ray's length: beyond a line that it crosses
_NONE = 1e-30  # in place of a step of 0, so that nothing is divided by it
_RAYS = 20_000  # that a thread casts at once


@dataclass(frozen=True, eq=False)
class Hits:
    """Where rays (P, 3) meet the ground or a board first.

    depth: (P,) float32, the ray's own length is 1, 0 where it meets nothing; normal: (P, 3) float32, of length 1;
    cell: (P,) the triangle's cell of the ground, row by row, -1 on a board or nothing; board: (P,) its number or -1.
    """

    depth: Array
    normal: Array
    cell: np.ndarray
    board: np.ndarray


class RayCaster:
    """The ground and the boards, ready for rays."""

    def __init__(self, terrain: Terrain, boards: tuple[Board, ...]) -> None:
        height = terrain.height.astype(np.float64)
        highest = np.maximum.reduce([height[:-1, :-1], height[:-1, 1:], height[1:, :-1], height[1:, 1:]])
        rows, columns = (-(-side // _BLOCK) for side in highest.shape)
        padded = np.full((rows * _BLOCK, columns * _BLOCK), -np.inf)
        padded[: highest.shape[0], : highest.shape[1]] = highest
        self._tops = padded.reshape(rows, _BLOCK, columns, _BLOCK).max(axis=(1, 3))
        self._height, self._grid, self._boards = height, terrain.grid, boards

    def cast(self, centre: Array, rays: Array) -> Hits:
        """Cast rays (P, 3) from a centre (3,), world metres."""
        grid, n = self._grid, len(rays)
        # In units of cells from the first height, which is at the centre of the grid's first cell.
        corner = (grid.x0 + 0.5 * grid.cell, grid.y0 + 0.5 * grid.cell, 0.0)
        units = np.array([grid.cell, grid.cell, 1.0])
        start, steps = (np.asarray(centre, dtype=np.float64) - corner) / units, rays / units
        depth, slope, cell = np.zeros(n), np.zeros((n, 2)), np.full(n, -1, dtype=np.int64)
        loop: Any = compiled(_meet_ground)

        def part(of: slice) -> None:
            loop(self._height, self._tops, start, steps[of], depth[of], slope[of], cell[of])

        with ThreadPoolExecutor(usable_cores()) as pool:
            list(pool.map(part, (slice(i, i + _RAYS) for i in range(0, n, _RAYS))))
        normal = np.column_stack([-slope / grid.cell, np.ones(n)])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        board = np.full(n, -1, dtype=np.int64)
        for number, one in enumerate(self._boards):
            met, facing = _meet_board(one.outline, centre, rays)
            first = (met > 0) & ((depth == 0) | (met < depth))
            depth[first], normal[first], cell[first], board[first] = met[first], facing, -1, number
        return Hits(depth.astype(np.float32), normal.astype(np.float32), cell, board)


def _meet_board(outline: Array, centre: Array, rays: Array) -> tuple[Array, Array]:
    """Return how far along each ray (P, 3) a rectangle (4, 3) is met, (P,), 0 where it is missed; and its normal."""
    corner, right, _, down = outline
    right, down = right - corner, down - corner
    normal = np.cross(down, right)
    with np.errstate(divide="ignore", invalid="ignore"):  # rays along the board
        met = ((corner - centre) @ normal) / (rays @ normal)
        at = centre - corner + rays * met[:, None]
        inside = np.stack([at @ right / (right @ right), at @ down / (down @ down)])
        hit = (met > 0) & (inside >= 0).all(axis=0) & (inside <= 1).all(axis=0)
    return np.where(hit, met, 0), normal / np.linalg.norm(normal)


def _meet_ground(
    height: Array, tops: Array, start: Array, steps: Array, depth: Array, slope: Array, cell: np.ndarray
) -> None:
    """Fill depth (P,), slope (P, 2) along columns and rows, and cell (P,), of rays that meet the ground.

    height: (rows, columns); tops: the greatest of each block of cells; start (3,), steps (P, 3): in cells, cells and
    metres. Compiled by numba.
    """
    rows, columns = height.shape[0] - 1, height.shape[1] - 1
    u0, v0, z0 = start
    for ray in range(len(steps)):
        du, dv, dz = steps[ray]
        du, dv = du if du != 0 else _NONE, dv if dv != 0 else _NONE
        # The part of the ray that is over the grid.
        t = max(0.0, min(-u0 / du, (columns - u0) / du), min(-v0 / dv, (rows - v0) / dv))
        end = min(max(-u0 / du, (columns - u0) / du), max(-v0 / dv, (rows - v0) / dv))
        while t < end:
            # Just beyond t, for at t itself the ray is on a line.
            j = min(max(int(v0 + (t + _BEYOND) * dv), 0), rows - 1)
            i = min(max(int(u0 + (t + _BEYOND) * du), 0), columns - 1)
            left, low = i // _BLOCK * _BLOCK, j // _BLOCK * _BLOCK
            leaves_u = (left + (_BLOCK if du > 0 else 0) - u0) / du
            leaves = max(min(end, leaves_u, (low + (_BLOCK if dv > 0 else 0) - v0) / dv), t + _BEYOND)
            if z0 + min(t * dz, leaves * dz) > tops[j // _BLOCK, i // _BLOCK]:
                t = leaves
                continue
            # The triangle on this side of the diagonal from the cell's first corner.
            first, last = height[j, i], height[j + 1, i + 1]
            if (u0 + (t + _BEYOND) * du) - i >= (v0 + (t + _BEYOND) * dv) - j:
                along_u, along_v = height[j, i + 1] - first, last - height[j, i + 1]
            else:
                along_u, along_v = last - height[j + 1, i], height[j + 1, i] - first
            leaves = min(leaves, (i + (1 if du > 0 else 0) - u0) / du, (j + (1 if dv > 0 else 0) - v0) / dv)
            diagonal = (i - j - u0 + v0) / (du - dv) if du != dv else leaves
            leaves = max(min(leaves, diagonal) if diagonal > t + _BEYOND else leaves, t + _BEYOND)
            # The ray's height above the triangle's plane at its start, and what it gains on the way.
            above = z0 - first - along_u * (u0 - i) - along_v * (v0 - j)
            gain = dz - along_u * du - along_v * dv
            if gain != 0 and t - _BEYOND <= -above / gain <= leaves + _BEYOND:
                depth[ray], slope[ray, 0], slope[ray, 1], cell[ray] = -above / gain, along_u, along_v, j * columns + i
                break
            t = leaves
