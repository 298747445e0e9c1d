"""A FLSea dive in miniature."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import tifffile

from support.spots import disk_depth, write_spot

K = np.array([[150.0, 0, 82.5], [0, 148, 56.5], [0, 0, 1]])  # of Kalibr: pixel centres at whole numbers
BENT = np.array([-0.3, 0.1, 0.004, -0.003])
POINT = np.array([1.6, -1.1, 5.0])  # of the camera, in a corner of the image
REPORT = f"""Calibration results
===================
Calibration configuration
=========================

cam0
-----
  Camera model: pinhole
  Focal length: [{K[0, 0]}, {K[1, 1]}]
  Principal point: [{K[0, 2]}, {K[1, 2]}]
  Distortion model: radtan
  Distortion coefficients: [{", ".join(map(str, BENT))}]
  Type: aprilgrid
"""
FRAMES = ("16233051861828957", "16233051862684293")


def spot() -> np.ndarray:
    return cv2.projectPoints(POINT[None], np.zeros(3), np.zeros(3), K, BENT)[0].ravel() + 0.5


def write_dive(root: Path, place: str = "canyons/flatiron/flatiron") -> Path:
    dive = root / place
    (dive / "depth").mkdir(parents=True)
    for frame in FRAMES:
        write_spot(dive / "imgs" / f"{frame}.tiff", spot())
        write_spot(dive / "seaErra" / f"{frame}_SeaErra.tiff", np.array([20.5, 30.5]))
        depth = disk_depth(spot(), POINT[2])
        depth[-1, 0] = 0
        tifffile.imwrite(dive / "depth" / f"{frame}_SeaErra_abs_depth.tif", depth)
    (root / "canyons" / "calibration").mkdir(exist_ok=True, parents=True)
    (root / "canyons" / "calibration" / "seaErra-kalibr-results-imucam.txt").write_text(REPORT)
    return dive
