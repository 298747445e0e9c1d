"""Smooth random fields over space: a point has the same value on every grid."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sucre_bench.arrays import Array

_LATTICE = 1024
_FINER = 2  # the lattice is interpolated to this much finer once, and linearly from then on
# What a step along z, an octave and a field move the lattice by, so that none of them repeats another.
_SLICE_X, _SLICE_Y, _OCTAVE, _FIELD = 371.17, 173.31, 211.43, 97.61


@dataclass(frozen=True)
class Grid:
    """A rectangle of ground sampled at the centres of square cells.

    x0, y0: its corner in world metres; width, length: its sides along x and y, metres; cell: metres.
    """

    x0: float
    y0: float
    width: float
    length: float
    cell: float

    @property
    def shape(self) -> tuple[int, int]:
        """(rows along y, columns along x)."""
        return round(self.length / self.cell), round(self.width / self.cell)

    def axes(self) -> tuple[Array, Array]:
        """Return x of every column and y of every row, float32 metres."""
        rows, columns = self.shape
        x = self.x0 + (np.arange(columns) + 0.5) * self.cell
        y = self.y0 + (np.arange(rows) + 0.5) * self.cell
        return x.astype(np.float32), y.astype(np.float32)

    def bands(self, rows: int) -> Iterator[Grid]:
        """Yield the grid in bands of so many rows (the last may have fewer)."""
        for first in range(0, self.shape[0], rows):
            count = min(rows, self.shape[0] - first)
            yield replace(self, y0=self.y0 + first * self.cell, length=count * self.cell)

    def padded(self, cells: int) -> Grid:
        """Return the grid with so many cells more on each side."""
        more = cells * self.cell
        x0, y0, width, length = self.x0 - more, self.y0 - more, self.width + 2 * more, self.length + 2 * more
        return Grid(x0, y0, width, length, self.cell)


class Noise:
    """Fractal value noise in space, from one periodic lattice of random values."""

    def __init__(self, seed: int) -> None:
        import cv2

        values = np.random.default_rng([seed, 1]).standard_normal((_LATTICE, _LATTICE), dtype=np.float32)
        side = _LATTICE * _FINER
        around = cv2.copyMakeBorder(values, 8, 8, 8, 8, cv2.BORDER_WRAP)
        finer = cv2.resize(around, None, fx=_FINER, fy=_FINER, interpolation=cv2.INTER_CUBIC)
        smooth = finer[8 * _FINER : 8 * _FINER + side, 8 * _FINER : 8 * _FINER + side]
        self._lattice = np.ascontiguousarray(smooth / smooth.std())

    def field(self, grid: Grid, z: Array | None, steps: Sequence[float], number: int, gain: float = 0.6) -> Array:
        """Return a field on the surface z over a grid: (rows, columns) float32, about zero mean and unit deviation.

        z: (rows, columns) metres, so that the field does not run in streaks down steep sides, None for a flat one;
        steps: its octaves' sizes in metres, coarse to fine, each `gain` times as strong as the one before; an octave
        finer than two cells is left out (it would alias); number: which field, of independent ones.
        """
        x, y = grid.axes()
        total = np.zeros(grid.shape, dtype=np.float32)
        for octave, step in enumerate(steps):
            if step < 2 * grid.cell:
                break
            u = x[None, :] * (1 / step) + np.float32(_OCTAVE * (octave + 1) + _FIELD * number)
            v = y[:, None] * (1 / step) + np.float32(_OCTAVE * (octave + 1) - _FIELD * number)
            total += np.float32(gain**octave) * (self._at(u, v) if z is None else self._sliced(u, v, z / step))
        return np.asarray(total / np.sqrt(sum(gain ** (2 * octave) for octave in range(len(steps)))), dtype=np.float32)

    def _sliced(self, u: Array, v: Array, w: Array) -> Array:
        """Blend the two flat fields next below and above w: noise in three dimensions."""
        below = np.floor(w)
        share = smoothstep(w - below, 0, 1)
        u, v = u + np.float32(_SLICE_X) * below, v + np.float32(_SLICE_Y) * below
        low, high = self._at(u, v), self._at(u + np.float32(_SLICE_X), v + np.float32(_SLICE_Y))
        return np.asarray((low + share * (high - low)) / np.sqrt(share**2 + (1 - share) ** 2))

    def _at(self, u: Array, v: Array) -> Array:
        import cv2

        shape = np.broadcast_shapes(u.shape, v.shape)
        u, v = (np.broadcast_to(_wrapped(a) * np.float32(_FINER), shape) for a in (u, v))
        return np.asarray(cv2.remap(self._lattice, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP))


def _wrapped(a: Array) -> Array:
    """Return a modulo the lattice's side: seven times as fast as `%` on float32."""
    return np.asarray(a - np.float32(_LATTICE) * np.floor(a * np.float32(1 / _LATTICE)))


def smoothstep(values: Array, low: float, high: float) -> Array:
    """Return 0 below low, 1 above high, and a smooth cubic between them."""
    t = ((values - low) * (1 / (high - low))).clip(0, 1)
    return np.asarray(t * t * (3 - 2 * t))
