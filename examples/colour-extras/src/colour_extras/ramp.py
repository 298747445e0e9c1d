"""A made dataset: a wall of colours seen from nearer and nearer through known water (SUCRe, eq. 2)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from sucre_bench import Camera, InputError, Scene, View, Water, dataset

HEIGHT = 48
WIDTH = 64
WATER = Water(np.array([0.05, 0.3, 0.35]), np.array([0.5, 0.12, 0.09]), np.array([0.35, 0.15, 0.12]))


@dataset(licence="MIT", source="made when it is opened", has=("depth", "poses", "reference", "truth"))
@dataclass(frozen=True)
class Ramp:
    """A wall whose colours run from dark to light and from red to blue, from far away to near."""

    views: int = 4
    """How many views, from 5 m to 1 m."""

    def __post_init__(self) -> None:
        if self.views < 1:
            raise InputError(f"ramp.views: {self.views} is too few; give 1 or more")

    def scenes(self) -> Iterator[Scene]:
        """Yield the one scene; a view is painted when it is asked for."""
        camera = Camera(np.array([[WIDTH, 0, WIDTH / 2], [0, WIDTH, HEIGHT / 2], [0, 0, 1.0]]), WIDTH, HEIGHT)
        views = []
        for number, distance in enumerate(np.linspace(5, 1, self.views)):
            pose = np.eye(4)
            pose[2, 3] = distance  # the wall is the world's plane z = 0
            views.append(View(f"{number}.png", _Painted(float(distance)), camera, pose))
        has = frozenset({"depth", "poses", "reference", "truth"})
        yield Scene("ramp", views, has, WATER, data_id=f"ramp1-{self.views}")


@dataclass(frozen=True)
class _Painted:
    """The wall from a distance in metres along the optical axis."""

    depth: float

    def load(self, plane: str) -> np.ndarray:
        """Return "rgb", "depth" or "reference", float32."""
        x = (np.arange(WIDTH) + 0.5 - WIDTH / 2) / WIDTH * self.depth  # metres on the wall
        y = (np.arange(HEIGHT) + 0.5 - HEIGHT / 2) / WIDTH * self.depth
        x, y = np.meshgrid(x, y)
        if plane == "depth":
            return np.full(x.shape, self.depth, np.float32)
        hue, light = (x / 5 + 0.5)[..., None], (y / 5 + 0.5)[..., None]
        wall = (0.2 + 0.7 * light) * (hue * np.array([0.2, 0.6, 1]) + (1 - hue) * np.array([1, 0.6, 0.2]))
        if plane == "reference":
            return wall.astype(np.float32)
        z = np.sqrt(self.depth**2 + x**2 + y**2)[..., None]
        veil = WATER.veiling_light * (1 - np.exp(-WATER.backscatter * z))
        return (wall * np.exp(-WATER.attenuation * z) + veil).astype(np.float32)
