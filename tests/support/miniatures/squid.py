"""A site of the SQUID data in miniature."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import scipy.io

from support.colmap_folder import HEIGHT, WIDTH

# As MATLAB writes them: matrices stand transposed, pixels count from 1, rows are points, millimetres.
LEFT: dict[str, Any] = {"IntrinsicMatrix": [[50.0, 0, 0], [0, 50, 0], [20.5, 15.5, 1]], "ImageSize": [[30.0, 40.0]]}
RIGHT: dict[str, Any] = {"IntrinsicMatrix": [[60.0, 0, 0], [0, 60, 0], [22.5, 15.5, 1]], "ImageSize": [[30.0, 40.0]]}
ROTATION, TRANSLATION = [[0.96, 0, 0.28], [0, 1, 0], [-0.28, 0, 0.96]], [[-150.0, 20.0, 400.0]]
STEREO: dict[str, Any] = {
    "CameraParameters1": LEFT | {"WorldUnits": "mm"},
    "CameraParameters2": RIGHT,
    "RotationOfCamera2": ROTATION,
    "TranslationOfCamera2": TRANSLATION,
}
WORLD = [0.55, 0.25, 2.0]  # metres, in the left camera's frame
# (x, y, z) R + t = (.528 - .56 - .15, .25 + .02, .154 + 1.92 + .4); K with the first pixel's centre at .5.
RIGHT_POINT = [-0.182, 0.27, 2.474]
LEFT_PIXEL = [50 * 0.55 / 2 + 20, 50 * 0.25 / 2 + 15]
RIGHT_PIXEL = [60 * -0.182 / 2.474 + 22, 60 * 0.27 / 2.474 + 15]


def picture16(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 65536, (HEIGHT, WIDTH, 3), dtype=np.uint16)


def write_site(site: Path, sets: tuple[str, ...] = ("image_set_01",), stereo: object = STEREO) -> Path:
    """Pairs of images, and distances that are 9 m but at the world point's pixels, and NaN in the first row."""
    for number, name in enumerate(sets):
        (site / name).mkdir(parents=True)
        maps = {}
        for seed, (image, key, pixel, point) in enumerate(
            [("LFT_4007", "dist_map_l", LEFT_PIXEL, WORLD), ("RGT_4011", "dist_map_r", RIGHT_PIXEL, RIGHT_POINT)]
        ):
            shown = picture16(2 * number + seed)[..., ::-1]
            assert cv2.imwrite(str(site / name / f"{image}resizedUndistort.tif"), shown)
            (site / name / f"{image}.NEF").write_bytes(b"raw")
            distance = np.full((HEIGHT, WIDTH), 9.0)
            distance[0], distance[1] = np.nan, 4000.0
            distance[int(pixel[1]), int(pixel[0])] = np.linalg.norm(point)
            maps[key] = distance
        scipy.io.savemat(site / name / "distanceFromCamera.mat", maps)
    if isinstance(stereo, bytes):
        (site / "stereoParams0.5.mat").write_bytes(stereo)
    else:
        scipy.io.savemat(site / "stereoParams0.5.mat", {"stereoParams": stereo})
    return site
