"""Programs that restore, the small scenes they are given, and what comes of it."""

import sys
from pathlib import Path

import numpy as np

from sucre_bench import Arrays, Camera, Restoration, Scene, View, restore

# no two channels alike, so that a swap shows
LEVELS = np.arange(4 * 6 * 3, dtype=np.float32).reshape(4, 6, 3) * 3
RGB = LEVELS / np.float32(255)
DEPTH = np.float32([[0, 0.5, 1, 1.5, 1.75, 1.999]]).repeat(4, axis=0)
PYTHON = f"{sys.executable} -S"


def scene_of(*names: str, depth: np.ndarray | None = None, encoding: str = "gamma") -> Scene:
    camera = Camera(np.array([[6.0, 0, 3], [0, 6, 2], [0, 0, 1]]), 6, 4)
    views = [View(name, Arrays(RGB, depth), camera, encoding=encoding) for name in names]
    return Scene("made", views, frozenset({"depth"} if depth is not None else ()))


def restored(run: str, scene: Scene | None = None, **options: object) -> Restoration:
    scene = scene or scene_of("a.png")
    return restore("command", scene, scene.views[0], run=run, **options)


def program(folder: Path, source: str) -> str:
    """The words that run a Python program of that source."""
    path = folder / "program.py"
    path.write_text(source)
    return f"{PYTHON} '{path}'"
