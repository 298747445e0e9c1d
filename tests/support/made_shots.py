"""Cameras that see made points."""

from __future__ import annotations

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.programs.prepare.shots import Shot
from support.photographed_valley import (
    CAMERA,
)


def make_shots(places: Array) -> list[Shot]:
    """Cameras that look along z, with points on the planes z = 2 + x / 10."""
    random = np.random.default_rng(1)
    xy = random.uniform(-3, 3, (400, 2))
    points = np.column_stack([xy, 2 + xy[:, 0] / 10])
    shots = []
    for i, place in enumerate(places):
        pose = np.eye(4)
        pose[:3, 3] = -place
        shots.append(Shot(f"{i}.png", CAMERA, pose, np.arange(400), points, np.zeros((400, 2)), np.full(400, 3)))
    return shots
