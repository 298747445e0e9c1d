"""An AQUALOC site in miniature."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from support.spots import (
    BOTH,
    HEIGHT,
    WIDTH,
    pose_of,
    seen,
    write_spot,
)

K = np.array([[110.0, 0, 82.5], [0, 112, 56.5], [0, 0, 1]])  # of Kalibr: pixel centres at whole numbers
BENT = np.array([-0.06, -0.004, 0.027, -0.03])
CALIBRATION = f"""cam0:
  camera_model: pinhole
  distortion_coeffs: {BENT.tolist()}
  distortion_model: equidistant
  intrinsics: [110.0, 112.0, 82.5, 56.5]
  resolution: [{WIDTH}, {HEIGHT}]
  rostopic: /camera/image_raw
"""


def spot(world_from_cam: np.ndarray) -> np.ndarray:
    points = seen(world_from_cam)[None, None]
    return cv2.fisheye.projectPoints(points, np.zeros(3), np.zeros(3), K, BENT)[0].ravel() + 0.5


def write_site(
    root: Path, site: str = "harbor", folder: str = "harbor_images_sequence_07", trajectory: str = "07"
) -> Path:
    """Frames 5 and 12 with poses, 20 without; an older trajectory whose scale is wrong."""
    frames = root / "raw_data" / folder
    lines = ["# img_nb tx ty tz qx qy qz qw"]
    for frame, one in zip((5, 12), BOTH, strict=True):
        pose = pose_of(*one)
        write_spot(frames / f"frame{frame:06d}.png", spot(pose))
        lines.append(" ".join(map(str, [frame, *pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()])))
    write_spot(frames / "frame000020.png", np.array([3.0, 4.0]))
    (root / f"{site}_calibration_files").mkdir(exist_ok=True)
    (root / f"{site}_calibration_files" / f"{site}_camera_calib.yaml").write_text(CALIBRATION)
    truth = root / f"{site}_groundtruth_files"
    truth.mkdir(exist_ok=True)
    (truth / f"new_{site}_colmap_traj_sequence_{trajectory}.txt").write_text("\n".join(lines))
    (truth / f"{site}_colmap_traj_sequence_{trajectory}.txt").write_text("5 9 9 9 0 0 0 1")
    return root
