"""Pictures and depth maps of the made seabed, without water and in it, and which charts a view shows.

One ray through the centre of a pixel finds its surface and depth. Its colour is the mean over the pixel's footprint on
that surface's plane. So a pixel never mixes two surfaces, and belongs to the depth it is given.

Water works on gamma-encoded intensities, I = J exp(-beta z) + B (1 - exp(-gamma z)) (SUCRe, eq. 5), with z the
distance from the camera.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from sucre_bench import Chart, Water
from sucre_bench.arrays import Array
from sucre_bench.camera import Camera, intrinsics, moved, pixel_rays, pose_of, project
from sucre_bench.datasets.demo import Preset, water_of
from sucre_bench.datasets.demo.seabed import Board, Terrain, Texture, sample
from sucre_bench.machine.compute import compiled, usable_cores

# Casts rays at the seabed and its boards: which surface each meets first, how far away, and how it is turned.
#
# The ground is a grid of heights with two triangles a cell. Seen from above, a ray crosses the grid's lines and the
# diagonals of its cells. Between two crossings it is over one triangle, so one subtraction says whether it goes below.
# Blocks of cells that lie lower than the ray are left in one step.

_BLOCK = 16  # cells along each side
_BEYOND = 1e-9  # of a ray's length: beyond a line that it crosses
_NONE = 1e-30  # in place of a step of 0, so that nothing is divided by it
_RAYS = 20_000  # that a thread casts at once


@dataclass(frozen=True, eq=False)
class Hits:
    """Where rays (P, 3) meet the ground or a board first."""

    depth: Array
    """Shape (P,), float32. The ray's own length is 1; 0 where it meets nothing."""

    normal: Array
    """Of length 1, (P, 3) float32."""

    cell: np.ndarray
    """The triangle's cell of the ground, row by row, (P,); -1 on a board or nothing."""

    board: np.ndarray
    """Number of the board, (P,); -1 where the ray meets none."""


class RayCaster:
    """The ground and the boards, ready for rays."""

    def __init__(self, terrain: Terrain, boards: tuple[Board, ...]) -> None:
        height = terrain.height.astype(np.float64)
        highest = np.maximum.reduce(
            [height[:-1, :-1], height[:-1, 1:], height[1:, :-1], height[1:, 1:]]
        )
        rows, columns = (-(-side // _BLOCK) for side in highest.shape)
        padded = np.full((rows * _BLOCK, columns * _BLOCK), -np.inf)
        padded[: highest.shape[0], : highest.shape[1]] = highest
        self._tops = padded.reshape(rows, _BLOCK, columns, _BLOCK).max(axis=(1, 3))
        self._height = height
        self._grid = terrain.grid
        self._boards = boards

    def cast(self, centre: Array, rays: Array) -> Hits:
        """Cast rays (P, 3) from a centre (3,), world metres."""
        grid = self._grid
        n = len(rays)
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
            depth[first] = met[first]
            normal[first] = facing
            cell[first] = -1
            board[first] = number
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
    height: Array,
    tops: Array,
    start: Array,
    steps: Array,
    depth: Array,
    slope: Array,
    cell: np.ndarray,
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
            leaves = max(
                min(end, leaves_u, (low + (_BLOCK if dv > 0 else 0) - v0) / dv), t + _BEYOND
            )
            if z0 + min(t * dz, leaves * dz) > tops[j // _BLOCK, i // _BLOCK]:
                t = leaves
                continue
            # The triangle on this side of the diagonal from the cell's first corner.
            first, last = height[j, i], height[j + 1, i + 1]
            if (u0 + (t + _BEYOND) * du) - i >= (v0 + (t + _BEYOND) * dv) - j:
                along_u, along_v = height[j, i + 1] - first, last - height[j, i + 1]
            else:
                along_u, along_v = last - height[j + 1, i], height[j + 1, i] - first
            leaves = min(
                leaves,
                (i + (1 if du > 0 else 0) - u0) / du,
                (j + (1 if dv > 0 else 0) - v0) / dv,
            )
            diagonal = (i - j - u0 + v0) / (du - dv) if du != dv else leaves
            leaves = max(
                min(leaves, diagonal) if diagonal > t + _BEYOND else leaves, t + _BEYOND
            )
            # The ray's height above the triangle's plane at its start, and what it gains on the way.
            above = z0 - first - along_u * (u0 - i) - along_v * (v0 - j)
            gain = dz - along_u * du - along_v * dv
            if gain != 0 and t - _BEYOND <= -above / gain <= leaves + _BEYOND:
                depth[ray] = -above / gain
                slope[ray, 0] = along_u
                slope[ray, 1] = along_v
                cell[ray] = j * columns + i
                break
            t = leaves


# The camera path: a survey that comes down to one place, sways, and looks more ahead as it comes nearer.

_RANGE_M = (8.5, 2.2)  # camera to the place looked at, first and last view
_PITCH_DEG = (45.0, 28.0)  # below the horizon
_SWAY_DEG = 15.0
_PLACE = (0.1, 0.45, 0.15)


def make_camera(width: int, height: int) -> Camera:
    """Return a camera with a horizontal field of 64 degrees, its principal point a little off the centre."""
    focal = 0.8 * width
    return Camera(intrinsics(focal, focal, 0.503 * width, 0.496 * height), width, height)


def make_path(views: int, seed: int) -> Array:
    """Return cam_from_world (views, 4, 4) float64, far to near; each step is nearer by the same ratio."""
    rng = np.random.default_rng([seed, 31])
    poses = []
    for s in np.linspace(0, 1, views):
        distance = _RANGE_M[0] * (_RANGE_M[1] / _RANGE_M[0]) ** s
        pitch = np.deg2rad(_PITCH_DEG[0] + s * (_PITCH_DEG[1] - _PITCH_DEG[0]))
        azimuth = np.deg2rad(_SWAY_DEG * np.sin(2 * np.pi * (1.3 * s + 0.1)))
        centre = (
            np.array(_PLACE) - distance * _direction(azimuth, pitch) + rng.normal(0, 0.02, 3)
        )
        wobble_azimuth, wobble_pitch, roll = np.deg2rad(rng.normal(0, (1.5, 1.0, 1.5)))
        poses.append(
            _look(centre, _direction(azimuth + wobble_azimuth, pitch + wobble_pitch), roll)
        )
    return np.stack(poses)


def _direction(azimuth: float, pitch: float) -> Array:
    return np.array(
        [np.sin(azimuth) * np.cos(pitch), np.cos(azimuth) * np.cos(pitch), -np.sin(pitch)]
    )


def _look(centre: Array, ahead: Array, roll: float) -> Array:
    """Return the pose of a camera at centre that looks ahead (x right, y down, z ahead), rolled about that axis."""
    right = np.cross(ahead, (0, 0, 1.0))
    right /= np.linalg.norm(right)
    down = np.cross(ahead, right)
    across = np.cos(roll) * right + np.sin(roll) * down
    turn = np.stack([across, np.cos(roll) * down - np.sin(roll) * right, ahead])
    return pose_of(turn, -turn @ centre)


_GRAZING = 0.2  # cosine; at flatter angles a footprint is not drawn out any longer
_PATCH_PX = 4.0  # a chart with smaller patches is not worth listing
_TOLERANCE = 0.01  # of the depth, between a chart and what the ray meets


@dataclass(frozen=True, eq=False)
class Surfaces:
    """All there is to see."""

    caster: RayCaster

    near: Texture
    """The seabed's texture."""

    far: Texture
    """A coarser one, for where the near one does not reach."""

    is_near: np.ndarray
    """Whether the near one reaches, a bool for each cell, row by row."""

    boards: tuple[Board, ...]


def build(terrain: Terrain, near: Texture, far: Texture, boards: Sequence[Board]) -> Surfaces:
    """Return the seabed and the boards, ready. near: the seabed's texture where it reaches; far: elsewhere."""
    x, y = (axis[:-1] for axis in terrain.grid.axes())
    is_near = near.covers(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
    return Surfaces(RayCaster(terrain, tuple(boards)), near, far, is_near, tuple(boards))


def render(surfaces: Surfaces, camera: Camera, cam_from_world: Array) -> tuple[Array, Array]:
    """Return the scene without water (H, W, 3) in [0, 1], gamma-encoded, and its depth (H, W), metres; both float32.

    Where there is nothing to see, both are 0.
    """
    world_from_cam = cam_from_world[:3, :3].T
    centre = (-world_from_cam @ cam_from_world[:3, 3]).astype(np.float32)
    rays = (pixel_rays(camera) @ world_from_cam.T).astype(np.float32).reshape(-1, 3)
    hits = surfaces.caster.cast(centre, rays)
    depth, normal = hits.depth, hits.normal

    # The plane that a neighbouring ray is cut with: the surface's, tilted towards the camera where it is grazed.
    towards = -rays / np.linalg.norm(rays, axis=1, keepdims=True)
    facing = (normal * towards).sum(axis=1)
    normal = normal + np.maximum(_GRAZING - facing, 0)[:, None] * towards
    along = (normal * rays).sum(axis=1)
    sides = []
    for step in (world_from_cam @ np.linalg.inv(camera.K))[:, :2].T.astype(np.float32):
        sides.append(depth[:, None] * (step - rays * ((normal @ step) / along)[:, None]))

    reference = np.zeros_like(rays)
    points = centre + rays * depth[:, None]
    is_near = (hits.cell >= 0) & surfaces.is_near[hits.cell]
    seen = [(surfaces.near, is_near), (surfaces.far, (hits.cell >= 0) & ~is_near)]
    seen += [
        (board.texture, hits.board == number) for number, board in enumerate(surfaces.boards)
    ]
    for texture, which in seen:
        here = np.flatnonzero(which)
        at, right, down = (
            values.take(here, axis=0) @ texture.axes.T for values in (points, *sides)
        )
        reference[here] = sample(texture, at, right, down)
    shape = (camera.height, camera.width)
    return reference.reshape(*shape, 3), depth.reshape(shape)


def visible_charts(
    surfaces: Surfaces, camera: Camera, cam_from_world: Array
) -> tuple[Chart, ...]:
    """Return the charts that a view shows whole, from their front, unhidden, with patches of at least 4 pixels."""
    charts = []
    centre = -cam_from_world[:3, :3].T @ cam_from_world[:3, 3]
    for board in surfaces.boards:
        corners, _ = project(camera, moved(board.corners, cam_from_world))
        inside = (corners > 0).all() and (corners < camera.size).all()
        # Clockwise in the image (y down), as the chart is read; seen from behind it is mirrored.
        (ax, ay), (bx, by) = corners[2] - corners[0], corners[3] - corners[1]
        patches, _ = project(camera, moved(board.patches, cam_from_world))  # (N, 4, 2)
        sides = np.linalg.norm(np.roll(patches, -1, axis=1) - patches, axis=-1)
        if not inside or ax * by - ay * bx <= 0 or sides.min() < _PATCH_PX:
            continue
        # Rays to the chart's corners and to the centre of each patch meet nothing before the chart.
        targets = np.concatenate([board.corners, board.patches.mean(axis=1)])
        seen = moved(targets, cam_from_world)
        met = surfaces.caster.cast(centre, (targets - centre) / seen[:, 2:]).depth
        if (np.abs(met - seen[:, 2]) < _TOLERANCE * seen[:, 2]).all():
            charts.append(Chart(board.site.name, board.site.kind, corners))
    return tuple(charts)


_OPEN_WATER_M = 1e4  # from there on, nothing but the veiling light


@dataclass(frozen=True, eq=False)
class Lamp:
    """The only light there is: fixed to the camera, brightest along its axis."""

    lamp_from_cam: Array
    """Rigid transform, (4, 4)."""

    covariance: Array
    """Of the Gaussian lobe in the lamp's own image plane (x / z, y / z), so unitless, (2, 2)."""


_LAMP_REACH_M = 3.0
_LAMP_STEPS = 32


def _lamp(
    left: float, above: float, right_deg: float, down_deg: float, covariance: tuple[float, ...]
) -> Lamp:
    """Return a lamp so many metres left of and above the camera, turned right and down by so many degrees."""
    (ca, cb), (sa, sb) = (
        np.cos(np.deg2rad((right_deg, down_deg))),
        np.sin(np.deg2rad((right_deg, down_deg))),
    )
    turn = np.array([[1, 0, 0], [0, cb, -sb], [0, sb, cb]]) @ np.array(
        [[ca, 0, -sa], [0, 1, 0], [sa, 0, ca]]
    )
    return Lamp(pose_of(turn, turn @ (left, above, 0)), np.reshape(covariance, (2, 2)))


LAMP = _lamp(
    left=0.15, above=0.25, right_deg=2.3, down_deg=3.5, covariance=(0.26, 0.02, 0.02, 0.18)
)


def apply(J: Array, z: Array, water: Water) -> Array:
    """Return the image I (..., 3) of colours J (..., 3) through z (...) metres of water, float64."""
    B, beta, gamma = water.veiling_light, water.attenuation, water.backscatter
    z = np.asarray(z, dtype=np.float64)[..., None]
    return np.asarray(J * np.exp(-beta * z) + B * (1 - np.exp(-gamma * z)))


def lamp_light(lamp: Lamp, points: Array) -> tuple[Array, Array]:
    """Return the lamp's light (...,) at points (..., 3) of the camera's frame, and its way there, metres.

    The light falls with the square of the way, and is 1 in the middle of the lobe _LAMP_REACH_M away.
    """
    seen = moved(points, lamp.lamp_from_cam)
    plane = seen[..., :2] / np.maximum(seen[..., 2:], 1e-6)
    lobe = np.exp(
        -0.5 * np.einsum("...i,ij,...j->...", plane, np.linalg.inv(lamp.covariance), plane)
    )
    way = np.linalg.norm(seen, axis=-1)
    return np.where(
        seen[..., 2] > 0, lobe * (_LAMP_REACH_M / np.maximum(way, 0.1)) ** 2, 0
    ), way


def underwater(J: Array, rays: Array, depth: Array, preset: Preset) -> Array:
    """Return what the camera records in a preset's water, before noise.

    J: (H, W, 3) the scene without water; rays: (H, W, 3) camera rays with third component 1; depth: (H, W) metres, 0
    where there is nothing but water.
    """
    points = np.asarray(
        rays * np.where(depth > 0, depth, _OPEN_WATER_M)[..., None], dtype=np.float64
    )
    distance = np.linalg.norm(points, axis=-1)
    if preset != "deep_sea":
        return apply(J, distance, water_of(preset))
    light, way = lamp_light(LAMP, points)
    water = water_of(preset)
    seen = J * light[..., None] * np.exp(-water.attenuation * (distance + way)[..., None])
    for s in (
        np.arange(_LAMP_STEPS) + 0.5
    ) / _LAMP_STEPS:  # finer near the camera, where the lamp is bright
        light, way = lamp_light(LAMP, points * s**2)
        along = distance * s**2
        fade = np.exp(
            -water.backscatter * along[..., None] - water.attenuation * way[..., None]
        )
        scattered = light * distance * 2 * s / _LAMP_STEPS
        seen = seen + water.veiling_light * water.backscatter * fade * scattered[..., None]
    return np.asarray(seen)
