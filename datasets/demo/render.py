"""Pictures and depth maps of the made seabed, without water and in it, and which charts a view shows.

One ray through the centre of a pixel finds its surface and depth. Its colour is the mean over the pixel's footprint on
that surface's plane. So a pixel never mixes two surfaces, and belongs to the depth it is given.

Water works on gamma-encoded intensities, I = J exp(-beta z) + B (1 - exp(-gamma z)) (SUCRe, eq. 5), with z the
distance from the camera.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.camera import Camera, moved, pixel_rays, project
from sucre_bench.datasets.demo import WATERS, Preset
from sucre_bench.datasets.demo.cast_rays import RayCaster
from sucre_bench.datasets.demo.seabed import Board, Terrain, Texture, sample
from sucre_bench.scene import Chart, Water

# The camera path: a survey that comes down to one place, sways, and looks more ahead as it comes nearer.

_RANGE_M = (8.5, 2.2)  # camera to the place looked at, first and last view
_PITCH_DEG = (45.0, 28.0)  # below the horizon
_SWAY_DEG = 15.0
_PLACE = (0.1, 0.45, 0.15)


def make_camera(width: int, height: int) -> Camera:
    """Return a camera with a horizontal field of 64 degrees, its principal point a little off the centre."""
    f = 0.8 * width
    return Camera(np.array([[f, 0, 0.503 * width], [0, f, 0.496 * height], [0, 0, 1.0]]), width, height)


def make_path(views: int, seed: int) -> Array:
    """Return cam_from_world (views, 4, 4) float64, far to near; each step is nearer by the same ratio."""
    rng = np.random.default_rng([seed, 31])
    poses = []
    for s in np.linspace(0, 1, views):
        distance = _RANGE_M[0] * (_RANGE_M[1] / _RANGE_M[0]) ** s
        pitch = np.deg2rad(_PITCH_DEG[0] + s * (_PITCH_DEG[1] - _PITCH_DEG[0]))
        azimuth = np.deg2rad(_SWAY_DEG * np.sin(2 * np.pi * (1.3 * s + 0.1)))
        centre = np.array(_PLACE) - distance * _direction(azimuth, pitch) + rng.normal(0, 0.02, 3)
        wobble_azimuth, wobble_pitch, roll = np.deg2rad(rng.normal(0, (1.5, 1.0, 1.5)))
        poses.append(_look(centre, _direction(azimuth + wobble_azimuth, pitch + wobble_pitch), roll))
    return np.stack(poses)


def _direction(azimuth: float, pitch: float) -> Array:
    return np.array([np.sin(azimuth) * np.cos(pitch), np.cos(azimuth) * np.cos(pitch), -np.sin(pitch)])


def _look(centre: Array, ahead: Array, roll: float) -> Array:
    """Return the pose of a camera at centre that looks ahead (x right, y down, z ahead), rolled about that axis."""
    right = np.cross(ahead, (0, 0, 1.0))
    right /= np.linalg.norm(right)
    down = np.cross(ahead, right)
    pose = np.eye(4)
    pose[0, :3] = np.cos(roll) * right + np.sin(roll) * down
    pose[1, :3] = np.cos(roll) * down - np.sin(roll) * right
    pose[2, :3] = ahead
    pose[:3, 3] = -pose[:3, :3] @ centre
    return pose


_GRAZING = 0.2  # cosine; at flatter angles a footprint is not drawn out any longer
_PATCH_PX = 4.0  # a chart with smaller patches is not worth listing
_TOLERANCE = 0.01  # of the depth, between a chart and what the ray meets


@dataclass(frozen=True, eq=False)
class Surfaces:
    """All there is to see. near: the seabed's texture; far: a coarser one where `is_near` (a bool for each cell, row by
    row) says that the near one does not reach."""

    caster: RayCaster
    near: Texture
    far: Texture
    is_near: np.ndarray
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
    seen += [(board.texture, hits.board == number) for number, board in enumerate(surfaces.boards)]
    for texture, which in seen:
        here = np.flatnonzero(which)
        at, right, down = (values.take(here, axis=0) @ texture.axes.T for values in (points, *sides))
        reference[here] = sample(texture, at, right, down)
    shape = (camera.height, camera.width)
    return reference.reshape(*shape, 3), depth.reshape(shape)


def visible_charts(surfaces: Surfaces, camera: Camera, cam_from_world: Array) -> tuple[Chart, ...]:
    """Return the charts that a view shows whole, from their front, unhidden, with patches of at least 4 pixels."""
    charts = []
    for board in surfaces.boards:
        corners, _ = project(camera, moved(board.corners, cam_from_world))
        inside = (corners > 0).all() and (corners < (camera.width, camera.height)).all()
        clear = inside and _front(corners) and _large(board, camera, cam_from_world)
        if clear and _unhidden(surfaces, board, cam_from_world):
            charts.append(Chart(board.site.name, board.site.kind, corners))
    return tuple(charts)


def _front(corners: Array) -> bool:
    """Clockwise in the image (y down), as the chart is read; seen from behind it would be mirrored."""
    (ax, ay), (bx, by) = corners[2] - corners[0], corners[3] - corners[1]
    return bool(ax * by - ay * bx > 0)


def _large(board: Board, camera: Camera, cam_from_world: Array) -> bool:
    patches, _ = project(camera, moved(board.patches, cam_from_world))  # (N, 4, 2)
    sides = np.linalg.norm(np.roll(patches, -1, axis=1) - patches, axis=-1)
    return bool(sides.min() >= _PATCH_PX)


def _unhidden(surfaces: Surfaces, board: Board, cam_from_world: Array) -> bool:
    """Whether rays to the chart's corners and to the centre of each patch meet nothing before the chart."""
    targets = np.concatenate([board.corners, board.patches.mean(axis=1)])
    seen = moved(targets, cam_from_world)
    centre = -cam_from_world[:3, :3].T @ cam_from_world[:3, 3]
    rays = (targets - centre) / seen[:, 2:]
    met = surfaces.caster.cast(centre, rays).depth
    return bool((np.abs(met - seen[:, 2]) < _TOLERANCE * seen[:, 2]).all())


_OPEN_WATER_M = 1e4  # from there on, nothing but the veiling light


@dataclass(frozen=True, eq=False)
class Lamp:
    """The only light there is: fixed to the camera, brightest along its axis.

    lamp_from_cam: (4, 4) rigid transform; covariance: (2, 2) of the Gaussian lobe in the lamp's own image plane
    (x / z, y / z), so unitless.
    """

    lamp_from_cam: Array
    covariance: Array


_LAMP_REACH_M, _LAMP_STEPS = 3.0, 32


def _lamp(left: float, above: float, right_deg: float, down_deg: float, covariance: tuple[float, ...]) -> Lamp:
    """Return a lamp so many metres left of and above the camera, turned right and down by so many degrees."""
    (ca, cb), (sa, sb) = np.cos(np.deg2rad((right_deg, down_deg))), np.sin(np.deg2rad((right_deg, down_deg)))
    pose = np.eye(4)
    pose[:3, :3] = np.array([[1, 0, 0], [0, cb, -sb], [0, sb, cb]]) @ np.array([[ca, 0, -sa], [0, 1, 0], [sa, 0, ca]])
    pose[:3, 3] = pose[:3, :3] @ (left, above, 0)
    return Lamp(pose, np.reshape(covariance, (2, 2)))


LAMP = _lamp(left=0.15, above=0.25, right_deg=2.3, down_deg=3.5, covariance=(0.26, 0.02, 0.02, 0.18))


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
    lobe = np.exp(-0.5 * np.einsum("...i,ij,...j->...", plane, np.linalg.inv(lamp.covariance), plane))
    way = np.linalg.norm(seen, axis=-1)
    return np.where(seen[..., 2] > 0, lobe * (_LAMP_REACH_M / np.maximum(way, 0.1)) ** 2, 0), way


def underwater(J: Array, rays: Array, depth: Array, preset: Preset) -> Array:
    """Return what the camera records in a preset's water, before noise.

    J: (H, W, 3) the scene without water; rays: (H, W, 3) camera rays with third component 1; depth: (H, W) metres, 0
    where there is nothing but water.
    """
    points = np.asarray(rays * np.where(depth > 0, depth, _OPEN_WATER_M)[..., None], dtype=np.float64)
    distance = np.linalg.norm(points, axis=-1)
    if preset != "deep_sea":
        return apply(J, distance, WATERS[preset])
    light, way = lamp_light(LAMP, points)
    water = WATERS[preset]
    seen = J * light[..., None] * np.exp(-water.attenuation * (distance + way)[..., None])
    for s in (np.arange(_LAMP_STEPS) + 0.5) / _LAMP_STEPS:  # finer near the camera, where the lamp is bright
        light, way = lamp_light(LAMP, points * s**2)
        along = distance * s**2
        fade = np.exp(-water.backscatter * along[..., None] - water.attenuation * way[..., None])
        scattered = light * distance * 2 * s / _LAMP_STEPS
        seen = seen + water.veiling_light * water.backscatter * fade * scattered[..., None]
    return np.asarray(seen)
