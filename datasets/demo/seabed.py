"""The made seabed: a sand flat with rubble and boulders that rises into a reef behind, its colours and its charts.

World axes: x right, y forward (towards the reef), z up, metres; the survey looks at the ground around the origin.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.chart_kinds import chart_kind
from sucre_bench.machine.compute import usable_cores

# Smooth random fields over space: a point has the same value on every grid.

_LATTICE = 1024
_FINER = 2  # the lattice is interpolated to this much finer once, and linearly from then on
# What a step along z, an octave and a field move the lattice by, so that none of them repeats another.
_SLICE_X = 371.17
_SLICE_Y = 173.31
_OCTAVE = 211.43
_FIELD = 97.61


@dataclass(frozen=True)
class Grid:
    """A rectangle of ground sampled at the centres of square cells."""

    # Its corner in world metres.
    x0: float
    y0: float

    # Its sides along x and y, metres.
    width: float
    length: float

    cell: float
    """Side of a cell, metres."""

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
        x0 = self.x0 - more
        y0 = self.y0 - more
        width = self.width + 2 * more
        length = self.length + 2 * more
        return Grid(x0, y0, width, length, self.cell)


class Noise:
    """Fractal value noise in space, from one periodic lattice of random values."""

    def __init__(self, seed: int) -> None:
        import cv2

        values = np.random.default_rng([seed, 1]).standard_normal(
            (_LATTICE, _LATTICE), dtype=np.float32
        )
        side = _LATTICE * _FINER
        around = cv2.copyMakeBorder(values, 8, 8, 8, 8, cv2.BORDER_WRAP)
        finer = cv2.resize(around, None, fx=_FINER, fy=_FINER, interpolation=cv2.INTER_CUBIC)
        smooth = finer[8 * _FINER : 8 * _FINER + side, 8 * _FINER : 8 * _FINER + side]
        self._lattice = np.ascontiguousarray(smooth / smooth.std())

    def field(
        self,
        grid: Grid,
        z: Array | None,
        steps: Sequence[float],
        number: int,
        gain: float = 0.6,
    ) -> Array:
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
            total += np.float32(gain**octave) * (
                self._at(u, v) if z is None else self._sliced(u, v, z / step)
            )
        return np.asarray(
            total / np.sqrt(sum(gain ** (2 * octave) for octave in range(len(steps)))),
            dtype=np.float32,
        )

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
        # Modulo the lattice's side: seven times as fast as `%` on float32.
        wrapped = (
            a - np.float32(_LATTICE) * np.floor(a * np.float32(1 / _LATTICE)) for a in (u, v)
        )
        u, v = (np.broadcast_to(a * np.float32(_FINER), shape) for a in wrapped)
        return np.asarray(
            cv2.remap(self._lattice, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        )


def smoothstep(values: Array, low: float, high: float) -> Array:
    """Return 0 below low, 1 above high, and a smooth cubic between them."""
    t = ((values - low) * (1 / (high - low))).clip(0, 1)
    return np.asarray(t * t * (3 - 2 * t))


# Flat pictures in metres, with coarser copies for far views: the surfaces of the seabed and the charts.
#
# A far pixel covers many texels. Taking one of them would give each view its own random choice, and the same point
# would change colour from view to view; so a pixel is the mean of samples over its own area, taken from the copy whose
# texels are as large as the samples' spacing.

_SAMPLES = 3  # a pixel is the mean of 3 x 3 samples
_LEVELS = 7


@dataclass(frozen=True, eq=False)
class Texture:
    """A flat picture and its coarser copies."""

    levels: tuple[np.ndarray, ...]
    """Each (h, w, 3) uint16, gamma-encoded / 65535, and half as fine as the one before."""

    texel: float
    """Side of a texel of the first level, metres."""

    origin: Array
    """The corner of the first texel, (2,) metres."""

    axes: Array
    """From a world point to the picture's two metres, (2, 3)."""

    def covers(self, at: Array) -> np.ndarray:
        """Whether the picture reaches to points (P, 2) in its metres: (P,) bool."""
        rows, columns = self.levels[0].shape[:2]
        return np.asarray(
            (
                (at > self.origin) & (at < self.origin + self.texel * np.array([columns, rows]))
            ).all(axis=1)
        )


def make_texture(albedo: Array, texel: float, origin: Array, axes: Array) -> Texture:
    """Return the texture of an albedo (h, w, 3) in [0, 1], row 0 at the origin."""
    import cv2

    levels: list[np.ndarray] = [(albedo * 65535 + 0.5).astype(np.uint16)]
    while len(levels) < _LEVELS and min(levels[-1].shape[:2]) >= 8:
        fine = levels[-1][: levels[-1].shape[0] // 2 * 2, : levels[-1].shape[1] // 2 * 2]
        levels.append(
            cv2.resize(
                fine, (fine.shape[1] // 2, fine.shape[0] // 2), interpolation=cv2.INTER_AREA
            )
        )
    return Texture(
        tuple(levels),
        texel,
        np.asarray(origin, dtype=np.float32),
        np.asarray(axes, dtype=np.float32),
    )


def sample(texture: Texture, at: Array, right: Array, down: Array) -> Array:
    """Return the mean colour (P, 3) float32 over parallelograms of the picture.

    at: (P, 2) centres; right, down: (P, 2) sides, all in the picture's metres.
    """
    import cv2

    spacing = np.maximum(np.linalg.norm(right, axis=1), np.linalg.norm(down, axis=1)) / _SAMPLES
    level = (
        np.log2(np.maximum(spacing / texture.texel, 1))
        .round()
        .clip(0, len(texture.levels) - 1)
        .astype(np.int8)
    )
    colour = np.zeros((len(at), 3), dtype=np.float32)
    none: Any = None  # the maps hold both coordinates
    offsets = (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5
    for fineness, picture in enumerate(texture.levels):
        (here,) = np.nonzero(level == fineness)
        # cv2 wants maps of less than 32,768 rows and columns, and counts from texel centres
        scale = 1 / (texture.texel * 2**fineness)
        for rows in np.array_split(here, len(here) // 30_000 + 1) if len(here) else ():
            start, u, v = (
                (at[rows] - texture.origin) * scale - 0.5,
                right[rows] * scale,
                down[rows] * scale,
            )
            total = np.zeros((len(rows), 1, 3), dtype=np.float32)
            for a in offsets:
                for b in offsets:
                    where = (start + np.float32(a) * u + np.float32(b) * v)[:, None, :]
                    total += cv2.remap(
                        picture,
                        where,
                        none,
                        cv2.INTER_LINEAR,
                        borderMode=cv2.BORDER_REFLECT_101,
                    )
            colour[rows] = total[:, 0] / (65535 * _SAMPLES**2)
    return colour


# What the cameras see of the ground, and a little more; a ray must never miss it.
GROUND = Grid(x0=-10.0, y0=-5.5, width=20.0, length=16.0, cell=0.025)

# Boulders by size: how many, smallest and largest radius (m), how near the origin they may come (m).
_TIERS = ((26, 0.5, 1.2, 2.6), (320, 0.18, 0.5, 1.0), (5500, 0.04, 0.14, 0.0))
_CLEARING_M = 0.55  # around a chart
# Of a boulder's turn (rad), flatness, stretch, sinking and hue; of the angle (rad), slope and level of its cuts.
_LEAST, _MOST = np.array([(0, 0.5, 0.75, 0.02, -1), (np.pi, 0.75, 1, 0.2, 1)])
_LEAST_CUT, _MOST_OF_CUTS = np.array([(0, 0.3, 0.3), (2 * np.pi, 1.6, 0.8)])
_SPAN = _MOST - _LEAST
_SPAN_OF_CUTS = _MOST_OF_CUTS - _LEAST_CUT


@dataclass(frozen=True, eq=False)
class Terrain:
    """The seabed on a grid."""

    grid: Grid

    height: Array
    """In metres, (rows, columns) float32."""

    rock: Array
    """Height above the sand under it, metres; 0 on sand."""

    tint: Array
    """A random number in [-1, 1] for each boulder, (rows, columns) float32."""


def make_terrain(seed: int, noise: Noise, clearings: Sequence[tuple[float, float]]) -> Terrain:
    """Return the seabed of a seed, with no boulders around the clearings (x, y)."""
    grid = GROUND
    sand = _sand(grid, noise)
    height, tint = sand.copy(), np.zeros_like(sand)
    rough = noise.field(grid, None, (0.4, 0.2, 0.1, 0.05), 1)
    rng = np.random.default_rng([seed, 2])
    x, y = grid.axes()
    for bx, by, r in _scatter(rng, clearings):
        # a rough dome cut by random planes, as broken rock is
        turn, flat, stretch, sink, hue = _LEAST + _SPAN * rng.random(5)
        angle, slope, level = (_LEAST_CUT + _SPAN_OF_CUTS * rng.random((5, 3))).T[
            ..., None, None
        ]
        columns = slice(*np.searchsorted(x, (bx - 1.4 * r, bx + 1.4 * r)))
        rows = slice(*np.searchsorted(y, (by - 1.4 * r, by + 1.4 * r)))
        here = (rows, columns)
        if not sand[here].size:
            continue
        u, v = ((x[columns] - bx) / r)[None, :], ((y[rows] - by) / r)[:, None]
        u, v = (
            np.cos(turn) * u + np.sin(turn) * v,
            (np.cos(turn) * v - np.sin(turn) * u) / stretch,
        )
        beyond = (u * u + v * v) * (1 + 0.12 * rough[here])
        cuts = level + slope * (1 - np.cos(angle) * u - np.sin(angle) * v) - 0.3 * slope
        dome = np.minimum(np.maximum(1 - beyond, 0), cuts.min(axis=0))
        dome = flat * r * dome * (1 + 0.06 * rough[here]) - sink * flat * r
        top = np.where(beyond < 1, sand[here].mean() + dome, -np.inf)
        higher = top > height[here]
        height[here][higher] = top[higher]
        tint[here][higher] = hue
    reef = smoothstep(sand, 0.3, 1.2)
    height += 0.05 * reef * rough  # the reef itself is rugged rock
    return Terrain(grid, height, np.maximum(height - sand, 0) + 0.1 * reef, tint)


def _sand(grid: Grid, noise: Noise) -> Array:
    """Return a gently wavy floor, rising by some metres in a bay around the origin: no camera sees the horizon."""
    x, y = grid.axes()
    across = y[:, None] + 0.05 * x[None, :] ** 2 + 0.6 * noise.field(grid, None, (3.0, 1.5), 2)
    ramp = np.maximum(across - 2.6, 0)
    rise = 0.2 * ramp**2 / (1 + 0.15 * ramp) + 0.02 * ramp
    rise *= 1 + 0.12 * noise.field(grid, None, (1.5, 0.8, 0.4), 3)
    return np.asarray(
        rise + 0.06 * noise.field(grid, None, (2.5, 1.2, 0.6, 0.3), 4, gain=0.5),
        dtype=np.float32,
    )


def _scatter(
    rng: np.random.Generator, clearings: Sequence[tuple[float, float]]
) -> Iterator[tuple[float, float, float]]:
    """Yield x, y and radius of boulders, metres: more of them towards the reef, large before small."""
    for count, smallest, largest, keep_off in _TIERS:
        placed = 0
        while placed < count:
            x = rng.uniform(GROUND.x0, GROUND.x0 + GROUND.width)
            y = GROUND.y0 + GROUND.length * rng.power(1.6)
            radius = smallest * (largest / smallest) ** rng.uniform()
            near = min(math.hypot(x - cx, y - cy) for cx, cy in clearings)
            # The corridor along which the camera comes holds only low rubble.
            corridor = radius > 0.15 and y < 0.8 and abs(x) < keep_off - 0.4 * y * (y < 0)
            if near > _CLEARING_M + radius and math.hypot(x, y) > keep_off and not corridor:
                placed += 1
                yield x, y, radius


# The colour charts: boards that stand on the seabed, painted with the reference colours of their kind.

# the board around the chart: black frame, bare rim, bare foot
_FRAME_M = 0.02
_RIM_M = 0.05
_FOOT_M = 0.12
_BARE = (0.86, 0.86, 0.84)
_FRAME = (0.04, 0.04, 0.04)


@dataclass(frozen=True)
class Site:
    """Where a chart stands."""

    # Those of the chart.
    name: str
    kind: str

    # Place of its foot, world metres.
    x: float
    y: float

    width: float
    """In metres."""

    heading: float
    """Towards which it is turned, degrees; 0 = towards -y, where the cameras are."""

    tilt: float
    """Back from upright, degrees."""


# One of each kind near the place that is looked at, and one of each kind behind it.
SITES = (
    Site("dgk-1", "dgk", -0.60, 0.25, 0.64, 8, 42),
    Site("colorchecker-1", "colorchecker24", 0.62, 0.60, 0.66, -10, 40),
    Site("dgk-2", "dgk", 1.95, 2.25, 0.70, -14, 35),
    Site("colorchecker-2", "colorchecker24", -1.65, 2.45, 0.72, 12, 35),
)


@dataclass(frozen=True, eq=False)
class Board:
    """A painted board."""

    site: Site

    # World metres of the board and of the chart on it, (4, 3), from the top left clockwise as it is read.
    outline: Array
    corners: Array

    patches: Array
    """The same of each of its patches, (N, 4, 3)."""

    texture: Texture


def place_board(site: Site, terrain: Terrain, texel: float) -> Board:
    """Return the board of a site, standing on the ground there. texel: of its picture, metres."""
    kind = chart_kind(site.kind)
    width = site.width
    height = width * kind.height / kind.width
    turn, tilt = np.deg2rad((site.heading, site.tilt))
    right = np.array([np.cos(turn), np.sin(turn), 0])
    back = np.array([-np.sin(turn), np.cos(turn), 0])
    down = -np.cos(tilt) * np.array([0, 0, 1.0]) - np.sin(tilt) * back
    nearest = (
        int((site.y - terrain.grid.y0) / terrain.grid.cell),
        int((site.x - terrain.grid.x0) / terrain.grid.cell),
    )
    foot = np.array([site.x, site.y, float(terrain.height[nearest])])
    margin = _FRAME_M + _RIM_M
    top_left = foot - right * width / 2 - down * (height + _FRAME_M + _FOOT_M)

    def on_board(u: float, v: float) -> Array:
        return np.asarray(top_left + u * right + v * down)

    def rectangle(u0: float, v0: float, u1: float, v1: float) -> Array:
        return np.stack(
            [on_board(u0, v0), on_board(u1, v0), on_board(u1, v1), on_board(u0, v1)]
        )

    boxes = [np.array(patch.box) * (width, height, width, height) for patch in kind.patches]
    axes = np.stack([right, down])
    return Board(
        site,
        outline=rectangle(-margin, -margin, width + margin, height + _FRAME_M + _FOOT_M),
        corners=rectangle(0, 0, width, height),
        patches=np.stack([rectangle(*box) for box in boxes]),
        texture=make_texture(
            _paint_board(site, width, height, texel), texel, axes @ top_left - margin, axes
        ),
    )


def _paint_board(site: Site, width: float, height: float, texel: float) -> Array:
    """Return the board's picture (h, w, 3): bare, with a black rectangle that holds the patches."""
    margin = _FRAME_M + _RIM_M
    x = np.arange(0, width + 2 * margin, texel) + texel / 2 - margin
    y = np.arange(0, height + margin + _FRAME_M + _FOOT_M, texel) + texel / 2 - margin
    picture = np.empty((len(y), len(x), 3), dtype=np.float32)
    picture[:] = _BARE

    def fill(x0: float, y0: float, x1: float, y1: float, colour: tuple[float, ...]) -> None:
        picture[slice(*np.searchsorted(y, (y0, y1))), slice(*np.searchsorted(x, (x0, x1)))] = (
            colour
        )

    fill(-_FRAME_M, -_FRAME_M, width + _FRAME_M, height + _FRAME_M, _FRAME)
    for patch in chart_kind(site.kind).patches:
        x0, y0, x1, y1 = patch.box
        fill(x0 * width, y0 * height, x1 * width, y1 * height, patch.srgb)
    return picture


# Albedos, gamma-encoded sRGB: natural seabed colours, chosen by eye.
_SAND = (0.72, 0.65, 0.53)
_SHELL = (0.90, 0.87, 0.80)
_ROCK_DARK = (0.34, 0.29, 0.26)
_ROCK_LIGHT = (0.66, 0.59, 0.50)
_TURF = (0.45, 0.42, 0.22)
_WEED = (0.27, 0.34, 0.15)
_CORALLINE = (0.66, 0.42, 0.47)
_SOFT_CORAL = (0.50, 0.38, 0.52)
_RED_SPONGE = (0.76, 0.30, 0.18)
_YELLOW_SPONGE = (0.80, 0.66, 0.26)

# of the seabed painted at once: what is worked on stays in the processor's cache
_BAND_ROWS = 128


def paint_seabed(terrain: Terrain, noise: Noise, grid: Grid) -> Texture:
    """Return the seabed's texture over a grid: sand, rock and what grows on it.

    It is shaded as by even light from above on a matt surface. That belongs to the surface and looks the same from
    everywhere, as the colour model requires.
    """
    shade = _shade(terrain)
    bands = list(grid.bands(_BAND_ROWS))
    with ThreadPoolExecutor(usable_cores()) as pool:
        painted = list(pool.map(lambda band: _paint(terrain, shade, noise, band), bands))
    return make_texture(
        np.concatenate(painted), grid.cell, np.array([grid.x0, grid.y0]), np.eye(2, 3)
    )


def _paint(terrain: Terrain, shade: Array, noise: Noise, band: Grid) -> Array:
    """Return the albedo of a band of the ground, shaded: (rows, columns, 3) float32."""
    grid = band.padded(1)  # for the slopes at its edges
    z, rock, tint, shade = (
        _over(grid, terrain.grid, of)
        for of in (terrain.height, terrain.rock, terrain.tint, shade)
    )
    fine = noise.field(grid, z, (0.064, 0.032, 0.016, 0.008), 11, gain=0.95)
    broad = noise.field(grid, z, (0.8, 0.4, 0.2, 0.1), 12, gain=0.75)
    growth = noise.field(grid, z, (0.6, 0.3, 0.15, 0.07, 0.035), 13, gain=0.65) + 0.2 * fine
    spots = noise.field(grid, z, (0.16, 0.08, 0.04), 14) + 0.15 * fine
    rocky = smoothstep(rock + 0.006 * fine, 0.008, 0.022)

    albedo = np.empty((*grid.shape, 3), dtype=np.float32)
    albedo[:] = _SAND
    albedo *= (1 + 0.05 * broad + 0.06 * fine)[..., None]
    _blend(albedo, _SHELL, 0.8 * smoothstep(fine + 0.5 * spots, 2.2, 2.6))
    stone = (0.5 + 0.16 * broad + 0.15 * fine + 0.25 * tint).clip(0, 1)[..., None]
    dark, light = np.array([_ROCK_DARK, _ROCK_LIGHT], dtype=np.float32)
    albedo += rocky[..., None] * (dark + stone * (light - dark) - albedo)
    _blend(albedo, _TURF, rocky * smoothstep(growth, 0.2, 0.9))
    _blend(albedo, _CORALLINE, rocky * smoothstep(-growth, 0.9, 1.3))
    _blend(albedo, _WEED, 0.8 * (1 - rocky) * smoothstep(growth, 1.3, 1.7))
    _blend(albedo, _RED_SPONGE, rocky * smoothstep(spots + 0.5 * broad, 1.7, 1.9))
    _blend(albedo, _YELLOW_SPONGE, rocky * smoothstep(0.5 * broad - spots, 1.8, 2.0))
    _blend(albedo, _SOFT_CORAL, rocky * smoothstep(spots - broad, 2.2, 2.4))
    # Light from one side brings out bumps of some millimetres.
    dy, dx = np.gradient(fine * (0.5 + 0.5 * rocky), grid.cell)
    shade *= 1 + 0.06 * fine + (0.0022 * (dx + 0.6 * dy)).clip(-0.35, 0.35)
    albedo *= shade[..., None]
    return albedo[1:-1, 1:-1].clip(0.02, 0.97)


def _over(grid: Grid, coarse: Grid, values: Array) -> Array:
    """Return values on the coarse grid as seen on another."""
    import cv2

    scale = grid.cell / coarse.cell
    shift = ((grid.x0 - coarse.x0) / coarse.cell, (grid.y0 - coarse.y0) / coarse.cell)
    warp = np.array(
        [[scale, 0, shift[0] + scale / 2 - 0.5], [0, scale, shift[1] + scale / 2 - 0.5]]
    )
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpAffine(
            values, warp, grid.shape[::-1], flags=flags, borderMode=cv2.BORDER_REPLICATE
        )
    )


def _blend(albedo: Array, colour: tuple[float, ...], cover: Array) -> None:
    albedo += cover[..., None] * (np.array(colour, dtype=np.float32) - albedo)


def _shade(terrain: Terrain) -> Array:
    """Return how much of an even sky each cell of the seabed sees, about 0.3 to 1.15."""
    import cv2

    height, cell = terrain.height, terrain.grid.cell
    dy, dx = np.gradient(height, cell)
    facing = (1 - 0.15 * dx + 0.1 * dy) / np.sqrt(1 + dx * dx + dy * dy)
    hollow = sum(
        ((height - cv2.GaussianBlur(height, (0, 0), s / cell)) / s).clip(-0.6, 0.6)
        for s in (0.05, 0.15, 0.5)
    )
    return np.asarray(
        (0.45 + 0.52 * facing.clip(0.1, 1.2) + 0.45 * hollow).clip(0.3, 1.15), dtype=np.float32
    )
