"""A flat ground of white noise under water, seen by cameras whose pixels average their whole area.

Written independently of the package: the ground is a grid of random texels, a pixel is the mean over the texels of its
footprint (7 x 7 rays), and water follows SUCRe's eq. 2. So the texture has detail at every scale, far pixels average
more of it than near ones, and everything is known.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from sucre_bench import Arrays, Camera, Restoration, Scene, View, Water
from support.made_scene import make_pose

TEXEL_M = 0.03
SIZE = 300  # texels a side
RAYS = 7  # a side of a pixel


def water(B: tuple[float, ...], beta: tuple[float, ...], gamma: tuple[float, ...]) -> Water:
    return Water(np.array(B), np.array(beta), np.array(gamma))


WATERS = {
    "blue ocean": water((0.05, 0.28, 0.43), (0.26, 0.07, 0.05), (0.19, 0.11, 0.10)),
    "coast": water((0.07, 0.36, 0.42), (0.42, 0.14, 0.13), (0.30, 0.20, 0.18)),
    "green": water((0.23, 0.45, 0.34), (0.56, 0.26, 0.34), (0.42, 0.32, 0.36)),
    "milky": water((0.40, 0.50, 0.48), (0.45, 0.35, 0.33), (0.50, 0.45, 0.40)),
    "red tide": water((0.35, 0.30, 0.20), (0.30, 0.35, 0.50), (0.25, 0.30, 0.45)),
}


# Views from near to far over a slope, which tell water and light apart.
SLOPE: dict[str, Any] = {
    "width": 160,
    "height": 120,
    "heights_m": (1.5, 2.0, 2.7, 3.6, 4.8, 6.4, 8.5),
    "tilt_deg": 30.0,
    "seed": 3,
}


def errors_of_water(result: Restoration, truth: Water | None) -> np.ndarray:
    """Relative errors (3, 3): rows B, beta, gamma; columns RGB."""
    assert truth is not None
    names = ("veiling_light", "attenuation", "backscatter")
    return np.array([getattr(result.water, name) / getattr(truth, name) - 1 for name in names])


def with_pictures(scene: Scene, change: Callable[[int, np.ndarray], np.ndarray]) -> Scene:
    """The scene with the picture change(k, rgb) of each view, as 8-bit images."""
    views = []
    for k, view in enumerate(scene.views):
        stored = np.rint(change(k, np.array(view.rgb)).clip(0, 1) * 255) / 255
        views.append(replace(view, pixels=Arrays(stored, view.depth, view.reference)))
    return replace(scene, views=views)


def make_ground(
    water: Water,
    *,
    heights_m: tuple[float, ...] = (1.2, 1.6, 2.2, 3.0, 4.2, 5.8),
    width: int = 120,
    height: int = 90,
    tilt_deg: float = 12.0,
    noise: float = 0.004,
    gains: tuple[float, ...] | None = None,
    seed: int = 0,
) -> Scene:
    """Cameras at these heights above z = 0 look down, a little tilted; 8-bit images; gains: of each view's exposure."""
    rng = np.random.default_rng(seed)
    texture = rng.uniform(0.0, 0.8, (SIZE, SIZE, 3)).astype(np.float32)
    camera = Camera(
        np.array([[1.1 * width, 0, width / 2], [0, 1.1 * width, height / 2], [0, 0, 1.0]]),
        width,
        height,
    )
    views = []
    for k, h in enumerate(heights_m):
        pose = looking_down(
            h, np.deg2rad(rng.uniform(-tilt_deg, tilt_deg, 2)), rng.uniform(-0.1, 0.1, 2)
        )
        rgb, depth, distance = photograph(texture, camera, pose)
        z = distance[..., None]
        seen = rgb * np.exp(-water.attenuation * z) + water.veiling_light * (
            1 - np.exp(-water.backscatter * z)
        )
        seen = seen * (1 if gains is None else gains[k]) + rng.normal(0, noise, seen.shape)
        stored = np.rint(seen.clip(0, 1) * 255) / 255
        views.append(View(f"{k}.png", Arrays(stored, depth, rgb), camera, pose))
    return Scene("ground", views, frozenset({"depth", "poses", "reference", "truth"}), water)


def looking_down(height: float, tilt: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """cam_from_world of a camera above the middle of the ground; x right, y down in the image, z into the ground."""
    pitch, yaw = tilt
    turn = make_pose((0, 0, 0), yaw, pitch)[:3, :3]
    pose = np.eye(4)
    pose[:3, :3] = turn @ np.diag([1.0, -1.0, -1.0])
    pose[:3, 3] = -pose[:3, :3] @ np.array([*shift, height])
    return pose


def photograph(
    texture: np.ndarray, camera: Camera, pose: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the picture without water (H, W, 3), each pixel the mean of its rays, its depth and distance (H, W)."""
    centre = -pose[:3, :3].T @ pose[:3, 3]
    to_world = np.linalg.inv(camera.K).T @ pose[:3, :3]  # of (u, v, 1)
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    corners = np.moveaxis(np.stack([u, v, np.ones_like(u)], axis=-1) @ to_world, -1, 0)

    def cast(du: float, dv: float) -> tuple[np.ndarray, np.ndarray]:
        x, y, z = corners + (np.array([du, dv, 0]) @ to_world)[:, None, None]
        depth = -centre[2] / z
        return np.stack([centre[0] + x * depth, centre[1] + y * depth]), depth

    total = np.zeros((camera.height, camera.width, 3))
    offsets = (np.arange(RAYS) + 0.5) / RAYS
    texels = texture.reshape(-1, 3)
    for dv in offsets:
        for du in offsets:
            column, row = np.floor(cast(du, dv)[0] / TEXEL_M).astype(np.int32) % SIZE
            total += np.take(texels, row * SIZE + column, axis=0)
    ground, depth = cast(0.5, 0.5)
    distance = np.sqrt(((ground - centre[:2, None, None]) ** 2).sum(axis=0) + centre[2] ** 2)
    return total / RAYS**2, depth, distance
