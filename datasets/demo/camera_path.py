"""The camera path: a survey that comes down to one place, sways, and looks more ahead as it comes nearer."""

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.camera import Camera

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
