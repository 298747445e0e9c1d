"""The colour charts: boards that stand on the seabed, painted with the reference colours of their kind."""

from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.datasets.demo.terrain import Terrain, height_at
from sucre_bench.datasets.demo.texture import Texture, make_texture
from sucre_bench.imaging.chart_kinds import KINDS

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
        texture=make_texture(_paint(site, width, height, texel), texel, axes @ top_left - margin, axes),
    )


def _paint(site: Site, width: float, height: float, texel: float) -> Array:
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
