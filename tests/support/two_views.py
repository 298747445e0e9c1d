"""Where the points of one view lie in another, by depth and poses alone."""

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.scene import View

Pixels = tuple[np.ndarray, np.ndarray]  # rows and columns


def carried(first: View, second: View) -> tuple[Pixels, Pixels, Array]:
    """The first view's pixels whose points lie in the second image, their pixels there, and their depths there."""
    v, u = np.nonzero(first.depth)
    rays = np.linalg.inv(first.camera.K) @ [u + 0.5, v + 0.5, np.ones(len(u))]
    world = np.linalg.inv(first.cam_from_world) @ [*(rays * first.depth[v, u]), np.ones(len(u))]
    there = (second.cam_from_world @ world)[:3]
    x, y, _ = second.camera.K @ there / there[2]
    kept = (x > 0) & (y > 0) & (x < second.camera.width) & (y < second.camera.height)
    return (v[kept], u[kept]), (y[kept].astype(int), x[kept].astype(int)), there[2, kept]
