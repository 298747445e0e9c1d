"""The made scenes of nature_scenes.py as a dataset, for `experiment=validity`.

Run: sucre-bench run -m --plugin benchmarks/nature_dataset.py experiment=validity dataset=nature every=1
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

import sucre_bench as sb

sys.path.append(str(Path(__file__).parent))

WATERS = ("coastal", "clear", "green", "blue", "haze", "deep")
PATHS = ("approach", "forward", "survey", "orbit")
CONDITIONS = (
    "plain", "JPEG 90", "all mild", "white balance 3 %", "noise .012", "fish in 1 view", "exposure 5 %", "vignette 15 %"
)  # fmt: skip


@sb.dataset(licence="MIT", has=("depth", "poses", "reference"))
@dataclass(frozen=True)
class Nature:
    """48 made scenes: six waters, four paths, eight conditions. Two views of each have a reference."""

    root: Path = Path("outputs/nature")
    """Folder that stores the scenes, which take minutes to make."""

    def scenes(self) -> Iterator[sb.Scene]:
        """Yield each scene."""
        from nature_scenes import make

        for seed, (turn, w, g) in enumerate(product(range(2), range(len(WATERS)), range(len(PATHS))), start=100):
            condition = CONDITIONS[(w + 2 * g + 3 * turn) % len(CONDITIONS)]
            made = make(condition, WATERS[w], PATHS[g], (160, 120), seed, views=8, cache=self.root)
            views = [
                sb.View(view.name, sb.Arrays(view.rgb, view.depth, reference), view.camera, view.cam_from_world)
                for view in made.scene.views
                for reference in [made.truth[view.name][1].astype(np.float32) if view.name in made.truth else None]
            ]
            has = made.scene.has | {"reference"}
            yield replace(made.scene, name=f"{made.scene.name} {seed}", views=views, has=has)
