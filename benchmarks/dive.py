"""What a long dive costs a view that only few others overlap.

Run: python benchmarks/dive.py. A camera flies 2,000 views along a straight line over a plane; one view in the middle is
paired with all of them, and with only those that overlap it, in the same run, in turns. Images are made when they are
read, and reads are counted: of views that do not overlap there must be none.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from sucre_bench import Camera, View
from sucre_bench.arrays import Array
from sucre_bench.multiview.observe import observe
from sucre_bench.scene import Plane

N_VIEWS = 2000
STEP_M = 0.1
DEPTH_M = 2.0
# sees 2.4 m of the line
CAMERA = Camera(np.array([[80.0, 0, 48], [0, 80, 36], [0, 0, 1]]), 96, 72)
# 23 on either side overlap, and a margin of a pixel may let two more pass for such.
REACH = int(CAMERA.width / 80 * DEPTH_M / STEP_M) - 1 + 2
TURNS = 9


@dataclass(eq=False)
class Made:
    """Pixels of a view of the plane, made when they are asked for and counted."""

    at_m: float
    loads: list[str] = field(default_factory=list)

    def load(self, plane: Plane) -> Array | None:
        self.loads.append(plane)
        if plane == "depth":
            return np.full((CAMERA.height, CAMERA.width), DEPTH_M, np.float32)
        along = self.at_m + (np.arange(CAMERA.width) + 0.5 - 48) / 80 * DEPTH_M
        gray = np.rint(127 + 100 * np.sin(along)) / 255
        return np.broadcast_to(gray[None, :, None], (CAMERA.height, CAMERA.width, 3)).astype(
            np.float32
        )


def make_views(places: range) -> list[View]:
    """New views, of which nothing is decoded yet."""
    views = []
    for k in places:
        pose = np.eye(4)
        pose[0, 3] = -k * STEP_M
        views.append(View(f"{k:04}.png", Made(k * STEP_M), CAMERA, pose))
    return views


def main() -> None:
    middle = N_VIEWS // 2
    near = range(middle - REACH, middle + REACH + 1)
    seconds: dict[str, list[float]] = {"the whole dive": [], "the views that overlap": []}
    for _ in range(TURNS):
        for name, places in zip(seconds, (range(N_VIEWS), near), strict=True):
            views = make_views(places)
            target = next(view for view in views if view.name == f"{middle:04}.png")
            started = time.perf_counter()
            observations = observe(target, views)
            seconds[name].append(time.perf_counter() - started)
            read = [view.name for view in views if view.pixels.loads]
            assert len(observations.views) <= len(read) <= len(near), (
                f"{len(read)} views were read"
            )
            assert set(read) <= {f"{k:04}.png" for k in near}
            assert all(len(view.pixels.loads) <= 2 for view in views), "a file was read twice"
    print(
        f"{N_VIEWS} views, {len(read)} of them read, {len(observations):,} observations in {len(observations.views)}\n"
    )
    print("pairing one view with           ms   ratio")
    fastest = {name: min(times) for name, times in seconds.items()}
    for name, its in fastest.items():
        print(f"{name:24} {its * 1e3:9.1f} {its / fastest['the views that overlap']:7.2f}")
    assert fastest["the whole dive"] < 2 * fastest["the views that overlap"], (
        "culling costs more than pairing"
    )


if __name__ == "__main__":
    main()
