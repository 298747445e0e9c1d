"""The colours of the seabed: sand, rock and their growth, as a picture seen from above."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.datasets.demo.terrain import Grid, Noise, Terrain, Texture, height_at, make_texture, smoothstep
from sucre_bench.imaging.chart_kinds import KINDS
from sucre_bench.machine.compute import usable_cores

# The colour charts: boards that stand on the seabed, painted with the reference colours of their kind.

_FRAME_M, _RIM_M, _FOOT_M = 0.02, 0.05, 0.12  # the board around the chart: black frame, bare rim, bare foot
_BARE = (0.86, 0.86, 0.84)
_FRAME = (0.04, 0.04, 0.04)


@dataclass(frozen=True)
class Site:
    """Where a chart stands: its name and kind, place (x, y) of its foot, width in metres, heading and tilt in degrees.

    heading: towards which it is turned, 0 = towards -y, where the cameras are; tilt: back from upright.
    """

    name: str
    kind: str
    x: float
    y: float
    width: float
    heading: float
    tilt: float


# One of each kind near the place that is looked at, and one of each kind behind it.
SITES = (
    Site("dgk-1", "dgk", -0.60, 0.25, 0.64, 8, 42),
    Site("colorchecker-1", "colorchecker24", 0.62, 0.60, 0.66, -10, 40),
    Site("dgk-2", "dgk", 1.95, 2.25, 0.70, -14, 35),
    Site("colorchecker-2", "colorchecker24", -1.65, 2.45, 0.72, 12, 35),
)


@dataclass(frozen=True, eq=False)
class Board:
    """A painted board. outline, corners: (4, 3) world metres of the board and of the chart on it, from the top left
    clockwise as it is read; patches: (N, 4, 3), of each of its patches."""

    site: Site
    outline: Array
    corners: Array
    patches: Array
    texture: Texture


def place_board(site: Site, terrain: Terrain, texel: float) -> Board:
    """Return the board of a site, standing on the ground there. texel: of its picture, metres."""
    kind = KINDS[site.kind]
    width, height = site.width, site.width * kind.height / kind.width
    turn, tilt = np.deg2rad((site.heading, site.tilt))
    right = np.array([np.cos(turn), np.sin(turn), 0])
    back = np.array([-np.sin(turn), np.cos(turn), 0])
    down = -np.cos(tilt) * np.array([0, 0, 1.0]) - np.sin(tilt) * back
    foot = np.array([site.x, site.y, height_at(terrain, site.x, site.y)])
    margin = _FRAME_M + _RIM_M
    top_left = foot - right * width / 2 - down * (height + _FRAME_M + _FOOT_M)

    def on_board(u: float, v: float) -> Array:
        return np.asarray(top_left + u * right + v * down)

    def rectangle(u0: float, v0: float, u1: float, v1: float) -> Array:
        return np.stack([on_board(u0, v0), on_board(u1, v0), on_board(u1, v1), on_board(u0, v1)])

    boxes = [np.array(patch.box) * (width, height, width, height) for patch in kind.patches]
    axes = np.stack([right, down])
    return Board(
        site,
        outline=rectangle(-margin, -margin, width + margin, height + _FRAME_M + _FOOT_M),
        corners=rectangle(0, 0, width, height),
        patches=np.stack([rectangle(*box) for box in boxes]),
        texture=make_texture(_paint_board(site, width, height, texel), texel, axes @ top_left - margin, axes),
    )


def _paint_board(site: Site, width: float, height: float, texel: float) -> Array:
    """Return the board's picture (h, w, 3): bare, with a black rectangle that holds the patches."""
    margin = _FRAME_M + _RIM_M
    x = np.arange(0, width + 2 * margin, texel) + texel / 2 - margin
    y = np.arange(0, height + margin + _FRAME_M + _FOOT_M, texel) + texel / 2 - margin
    picture = np.empty((len(y), len(x), 3), dtype=np.float32)
    picture[:] = _BARE

    def fill(x0: float, y0: float, x1: float, y1: float, colour: tuple[float, ...]) -> None:
        picture[slice(*np.searchsorted(y, (y0, y1))), slice(*np.searchsorted(x, (x0, x1)))] = colour

    fill(-_FRAME_M, -_FRAME_M, width + _FRAME_M, height + _FRAME_M, _FRAME)
    for patch in KINDS[site.kind].patches:
        x0, y0, x1, y1 = patch.box
        fill(x0 * width, y0 * height, x1 * width, y1 * height, patch.srgb)
    return picture


# Albedos, gamma-encoded sRGB: natural seabed colours, chosen by eye.
_SAND, _SHELL = (0.72, 0.65, 0.53), (0.90, 0.87, 0.80)
_ROCK_DARK, _ROCK_LIGHT = (0.34, 0.29, 0.26), (0.66, 0.59, 0.50)
_TURF, _WEED = (0.45, 0.42, 0.22), (0.27, 0.34, 0.15)
_CORALLINE, _SOFT_CORAL = (0.66, 0.42, 0.47), (0.50, 0.38, 0.52)
_RED_SPONGE, _YELLOW_SPONGE = (0.76, 0.30, 0.18), (0.80, 0.66, 0.26)

_BAND_ROWS = 128  # of the seabed painted at once: what is worked on stays in the processor's cache


def paint_seabed(terrain: Terrain, noise: Noise, grid: Grid) -> Texture:
    """Return the seabed's texture over a grid: sand, rock and what grows on it.

    It is shaded as by even light from above on a matt surface: that belongs to the surface and looks the same from
    everywhere, as the colour model requires.
    """
    shade = _shade(terrain)
    bands = list(grid.bands(_BAND_ROWS))
    with ThreadPoolExecutor(usable_cores()) as pool:
        painted = list(pool.map(lambda band: _paint(terrain, shade, noise, band), bands))
    return make_texture(np.concatenate(painted), grid.cell, np.array([grid.x0, grid.y0]), np.eye(2, 3))


def _paint(terrain: Terrain, shade: Array, noise: Noise, band: Grid) -> Array:
    """Return the albedo of a band of the ground, shaded: (rows, columns, 3) float32."""
    grid = band.padded(1)  # for the slopes at its edges
    z, rock, tint, shade = (_over(grid, terrain.grid, of) for of in (terrain.height, terrain.rock, terrain.tint, shade))
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
    shade *= 1 + 0.06 * fine + _relief(fine * (0.5 + 0.5 * rocky), grid.cell)
    albedo *= shade[..., None]
    return albedo[1:-1, 1:-1].clip(0.02, 0.97)


def _over(grid: Grid, coarse: Grid, values: Array) -> Array:
    """Return values on the coarse grid as seen on another."""
    import cv2

    scale = grid.cell / coarse.cell
    shift = ((grid.x0 - coarse.x0) / coarse.cell, (grid.y0 - coarse.y0) / coarse.cell)
    warp = np.array([[scale, 0, shift[0] + scale / 2 - 0.5], [0, scale, shift[1] + scale / 2 - 0.5]])
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(values, warp, grid.shape[::-1], flags=flags, borderMode=cv2.BORDER_REPLICATE))


def _blend(albedo: Array, colour: tuple[float, ...], cover: Array) -> None:
    albedo += cover[..., None] * (np.array(colour, dtype=np.float32) - albedo)


def _shade(terrain: Terrain) -> Array:
    """Return how much of an even sky each cell of the seabed sees, about 0.3 to 1.15."""
    import cv2

    height, cell = terrain.height, terrain.grid.cell
    dy, dx = np.gradient(height, cell)
    facing = (1 - 0.15 * dx + 0.1 * dy) / np.sqrt(1 + dx * dx + dy * dy)
    hollow = sum(((height - cv2.GaussianBlur(height, (0, 0), s / cell)) / s).clip(-0.6, 0.6) for s in (0.05, 0.15, 0.5))
    return np.asarray((0.45 + 0.52 * facing.clip(0.1, 1.2) + 0.45 * hollow).clip(0.3, 1.15), dtype=np.float32)


def _relief(bumps: Array, cell: float) -> Array:
    """Return how light from one side brings out bumps (deviations, of some millimetres each), about zero mean."""
    dy, dx = np.gradient(bumps, cell)
    return np.asarray((0.0022 * (dx + 0.6 * dy)).clip(-0.35, 0.35))
