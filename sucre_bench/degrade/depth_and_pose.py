"""Degrades geometry: noise and holes in depth maps, noise of poses."""

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.degrade.random_numbers import random_field


def noisy_depth(depth: Array, relative_sd: float, grain_px: float, rng: np.random.Generator) -> Array:
    """Return depth d (1 + sd n), (H, W) float32 metres, n a Gaussian random field; negative values become 0.

    depth: (H, W) metres, 0 = unknown, which stays; grain_px: see `random_field`.
    """
    field = random_field(rng, (depth.shape[0], depth.shape[1]), grain_px)
    return np.asarray((depth * (1 + relative_sd * field)).clip(0), dtype=np.float32)


def with_holes(depth: Array, share: float, grain_px: float, rng: np.random.Generator) -> Array:
    """Return depth (H, W) with holes: a share of its known pixels, where a random field is lowest."""
    field, known = random_field(rng, (depth.shape[0], depth.shape[1]), grain_px), depth > 0
    if not known.any():
        return depth
    lost = field < np.quantile(field[known], share)
    return np.where(lost, np.float32(0), depth)


def noisy_pose(cam_from_world: Array, sd_m: float, sd_deg: float, rng: np.random.Generator) -> Array:
    """Return a (4, 4) pose whose centre is moved along each axis, and which is turned about each of the camera's axes.

    sd_m, sd_deg: standard deviations of each of the three, in metres and degrees; the camera turns about its centre.
    """
    from scipy.spatial.transform import Rotation

    shift, turn = rng.standard_normal((2, 3)) * [[sd_m], [sd_deg]]
    rotation = cam_from_world[:3, :3]
    centre = -rotation.T @ cam_from_world[:3, 3] + shift
    noisy = np.eye(4)
    noisy[:3, :3] = Rotation.from_rotvec(turn, degrees=True).as_matrix() @ rotation
    noisy[:3, 3] = -noisy[:3, :3] @ centre
    return noisy
