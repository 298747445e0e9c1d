"""Scenes for degradations: one view, or many in a row."""

from __future__ import annotations

import numpy as np

from sucre_bench import Arrays, Camera, Scene, View
from sucre_bench.arrays import Array
from sucre_bench.scene import Encoding
from support.made_scene import make_pose

NINE = (0.1, 0.2, 0.3, 0.4, 0.2, 0.1, 0.3, 0.2, 0.15)


def of(
    rgb: Array,
    depth: Array | None = None,
    reference: Array | None = None,
    encoding: Encoding = "gamma",
    camera: Camera | None = None,
) -> Scene:
    """A scene of one view "a.png"."""
    planes = {"depth": depth, "reference": reference, "poses": camera}
    view = View("a.png", Arrays(rgb, depth, reference), camera, None if camera is None else np.eye(4), (), encoding)
    has = frozenset(name for name, value in planes.items() if value is not None)
    return Scene("one", [view], has, data_id="one")


def photo(height: int = 60, width: int = 80) -> Array:
    """A smooth picture of known 8-bit values."""
    v, u = np.mgrid[:height, :width]
    waves = [0.5 + 0.4 * np.sin(u / 7 + v / 11 + c) for c in range(3)]
    return np.asarray(np.rint(np.stack(waves, axis=-1) * 255) / 255, dtype=np.float32)


def many(count: int = 9) -> Scene:
    """Views v0.png, v1.png, ... in that order, 1 m apart."""
    camera = Camera(np.diag([50.0, 50, 1]), 20, 16)
    views = [
        View(f"v{n}.png", Arrays(photo(16, 20), np.full((16, 20), 2.0)), camera, make_pose((n, 0, 0), 0.1 * n))
        for n in range(count)
    ]
    return Scene("many", views, frozenset({"depth", "poses"}), data_id="many")
