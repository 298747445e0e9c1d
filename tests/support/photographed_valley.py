"""Two slanted planes with a texture, photographed by a distorting camera: a world that COLMAP finds again."""

import functools
from pathlib import Path

import cv2
import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.camera import Camera
from sucre_bench.programs.prepare.shots import Shot
from support.made_scene import make_pose

WIDTH = 240
HEIGHT = 180
FOCAL = 217.5
CAMERA = Camera(
    np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]]), WIDTH, HEIGHT
)
DISTORTION = np.array([-0.08, 0, 0, 0])
# n . X = 1: they meet in a valley some 2.5 m away
PLANES = np.array([[0.11, 0.03, 0.4], [-0.14, 0.02, 0.41]])
PLACES = [
    (0, 0, 0),
    (0.18, 0.05, 0.05),
    (0.38, -0.04, 0.1),
    (0.55, 0.1, 0),
    (0.2, 0.3, 0.2),
    (0.45, 0.35, -0.1),
]
# Turned: cameras that only move tell the focal length from nothing, and so no depth.
TURNS = [
    (0.1, -0.1, 0.0),
    (0.0, 0.05, 0.4),
    (-0.1, 0.0, -0.3),
    (-0.15, -0.05, 0.1),
    (0.05, 0.15, 0.7),
    (-0.1, 0.1, 0.2),
]
POSES = [make_pose(place, *turn) for place, turn in zip(PLACES, TURNS, strict=True)]
NAMES = [f"dive 1/photo {i}.png" for i in range(len(PLACES))]


def true_depth(pose: Array, rays: Array) -> Array:
    """Planar depth along rays of unit depth of a camera."""
    world_from_cam = np.linalg.inv(pose)
    depths = (1 - PLANES @ world_from_cam[:3, 3]) / (rays @ world_from_cam[:3, :3].T @ PLANES.T)
    return depths.min(axis=-1)


@functools.cache
def texture() -> np.ndarray:
    """What covers the planes, of three sizes of grain."""
    random = np.random.default_rng(3)
    grains = [random.normal(size=(side, side)) for side in (64, 128, 256)]
    return np.sum(
        [cv2.resize(one, (1024, 1024), interpolation=cv2.INTER_CUBIC) for one in grains], axis=0
    )


def photograph(pose: Array) -> np.ndarray:
    """What the distorting camera sees (H, W, 3) uint8."""
    K = CAMERA.K.copy()
    K[:2, 2] -= 0.5
    u, v = np.meshgrid(np.arange(WIDTH, dtype=np.float64), np.arange(HEIGHT, dtype=np.float64))
    straight = cv2.undistortPoints(
        np.stack([u, v], -1).reshape(-1, 1, 2), K, DISTORTION
    ).reshape(HEIGHT, WIDTH, 2)
    rays = np.concatenate([straight, np.ones((HEIGHT, WIDTH, 1))], axis=-1)
    world_from_cam = np.linalg.inv(pose)
    points = (rays * true_depth(pose, rays)[..., None]) @ world_from_cam[
        :3, :3
    ].T + world_from_cam[:3, 3]
    at = ((points[..., :2] + 2.5) * 200).astype(np.float32)
    seen = cv2.remap(
        texture(), at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP
    )
    gray = 110 + 35 * seen
    return np.clip(gray[..., None] + [30, 10, -40], 0, 255).astype(np.uint8)


def write(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def make_shots(places: Array) -> list[Shot]:
    """Cameras that look along z, with points on the planes z = 2 + x / 10."""
    random = np.random.default_rng(1)
    xy = random.uniform(-3, 3, (400, 2))
    points = np.column_stack([xy, 2 + xy[:, 0] / 10])
    shots = []
    for i, place in enumerate(places):
        pose = np.eye(4)
        pose[:3, 3] = -place
        shots.append(
            Shot(
                f"{i}.png",
                CAMERA,
                pose,
                np.arange(400),
                points,
                np.zeros((400, 2)),
                np.full(400, 3),
            )
        )
    return shots
