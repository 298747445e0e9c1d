"""Views with the pictures that methods made of them, as a run leaves them: written by hand."""

from __future__ import annotations

from pathlib import Path, PurePosixPath

import cv2
import numpy as np

from sucre_bench import Arrays, Camera, View
from sucre_bench.engine.reopen_results import Frame
from sucre_bench.results.layout import Place


def make_frame(out: Path, view: View, **pictures: np.ndarray) -> Frame:
    """A frame with pictures (H, W, 3) uint8 by method, kept under `out`."""
    place = Place("made", PurePosixPath(view.name).with_suffix(""))
    for method, picture in pictures.items():
        path = place.restored(out, method)
        path.parent.mkdir(parents=True, exist_ok=True)
        assert cv2.imwrite(str(path), picture[..., ::-1])
    return Frame(view, place, out)


def wall_view(name: str, rgb: np.ndarray, depth: float = 2.005, focal: float = 40.0, x: float = 0.0) -> View:
    """A camera at (x, 0, 0), looking along z at a wall that fills its image; rgb: (H, W, 3) in [0, 1]."""
    height, width = rgb.shape[:2]
    camera = Camera(np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1.0]]), width, height)
    pose = np.eye(4)
    pose[0, 3] = -x
    return View(name, Arrays(rgb, np.full((height, width), depth)), camera, pose)


def plain(colour: tuple[int, int, int], height: int = 48, width: int = 64) -> np.ndarray:
    """A picture of one colour, uint8."""
    return np.full((height, width, 3), colour, np.uint8)
