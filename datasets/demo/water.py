"""Waters of known parameters, and how they change an image.

The model works on gamma-encoded intensities, I = J exp(-beta z) + B (1 - exp(-gamma z)) (SUCRe, eq. 5), with z the
distance from the camera. The presets are chosen by eye to look like photographs, from clear ocean to turbid coast.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.camera import moved
from sucre_bench.scene import Water

Preset = Literal["clear", "coastal", "turbid", "deep_sea"]


def _water(B: tuple[float, ...], beta: tuple[float, ...], gamma: tuple[float, ...]) -> Water:
    return Water(np.array(B), np.array(beta), np.array(gamma))


WATERS: dict[Preset, Water] = {
    "clear": _water((0.05, 0.28, 0.43), (0.26, 0.07, 0.05), (0.19, 0.11, 0.10)),
    "coastal": _water((0.07, 0.36, 0.42), (0.42, 0.14, 0.13), (0.30, 0.20, 0.18)),
    "turbid": _water((0.23, 0.45, 0.34), (0.56, 0.26, 0.34), (0.42, 0.32, 0.36)),
    "deep_sea": _water((0.02, 0.13, 0.17), (0.19, 0.06, 0.055), (0.08, 0.07, 0.07)),
}

_OPEN_WATER_M = 1e4  # from there on, nothing but the veiling light


@dataclass(frozen=True, eq=False)
class Lamp:
    """The only light there is: fixed to the camera, brightest along its axis.

    lamp_from_cam: (4, 4) rigid transform; covariance: (2, 2) of the Gaussian lobe in the lamp's own image plane
    (x / z, y / z), so unitless.
    """

    lamp_from_cam: Array
    covariance: Array


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
    """Return the lamp's light (...,) in [0, 1] at points (..., 3) of the camera's frame, and its way there, metres."""
    seen = moved(points, lamp.lamp_from_cam)
    plane = seen[..., :2] / seen[..., 2:]
    lobe = np.exp(-0.5 * np.einsum("...i,ij,...j->...", plane, np.linalg.inv(lamp.covariance), plane))
    return np.where(seen[..., 2] > 0, lobe, 0), np.linalg.norm(seen, axis=-1)


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
    return light[..., None] * apply(J, distance + way, WATERS[preset])
