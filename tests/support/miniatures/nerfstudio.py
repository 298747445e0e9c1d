"""A nerfstudio scene in miniature."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from support.spots import (
    BOTH,
    HEIGHT,
    WIDTH,
    disk_depth,
    pose_of,
    seen,
    write_spot,
)

INTRINSICS = {"fl_x": 150.0, "fl_y": 140.0, "cx": 83.0, "cy": 57.5}
LENSES: dict[str, dict[str, Any]] = {
    "pinhole": {"camera_model": "PINHOLE"},
    "perspective": {"camera_model": "OPENCV", "k1": -0.5, "k2": 0.15, "p1": 0.004, "p2": -0.006},
    "four radial terms": {"camera_model": "OPENCV", "k1": -0.12, "k2": 0.03, "k3": -0.02, "k4": 0.02},
    "fisheye": {"camera_model": "OPENCV_FISHEYE", "k1": 0.02, "k2": -0.03, "k3": 0.004, "k4": -0.001},
}


def photographed(x: float, y: float, lens: dict[str, Any]) -> np.ndarray:
    """Where the lens images the ray (x, y, 1): pixels with centres at +0.5."""
    k, p = [lens.get(f"k{i}", 0.0) for i in range(1, 5)], [lens.get(f"p{i}", 0.0) for i in (1, 2)]
    r = np.hypot(x, y)
    if "FISHEYE" in lens["camera_model"]:
        t = np.arctan(r)
        x, y = (v * t / r * (1 + k[0] * t**2 + k[1] * t**4 + k[2] * t**6 + k[3] * t**8) for v in (x, y))
    else:
        radial = 1 + k[0] * r**2 + k[1] * r**4 + k[2] * r**6 + k[3] * r**8
        x, y = (
            x * radial + 2 * p[0] * x * y + p[1] * (r**2 + 2 * x**2),
            y * radial + p[0] * (r**2 + 2 * y**2) + 2 * p[1] * x * y,
        )
    return np.array([INTRINSICS["fl_x"] * x + INTRINSICS["cx"], INTRINSICS["fl_y"] * y + INTRINSICS["cy"]])


def frame_of(number: int, scale: float = 1.0) -> tuple[np.ndarray, list[list[float]]]:
    """The point in a camera's frame, and the camera's pose as nerfstudio writes it: y up, z back."""
    pose = pose_of(*BOTH[number])
    opengl = pose @ np.diag([1.0, -1.0, -1.0, 1.0])
    opengl[:3, 3] *= scale
    return seen(pose), opengl.tolist()


def write_scene(root: Path, lens: str = "pinhole", **more: Any) -> Path:
    """Two images of the point, 16-bit depth maps in millimetres of the images as they are stored."""
    common = {**LENSES[lens], **INTRINSICS, "w": WIDTH, "h": HEIGHT, **more}
    frames = []
    for number in range(2):
        (x, y, z), matrix = frame_of(number, more.get("applied_scale", 1.0))
        at = photographed(x / z, y / z, LENSES[lens])
        write_spot(root / f"images/{number}.png", at)
        unit = more.get("depth_unit_scale_factor", 0.001)
        (root / "depths").mkdir(exist_ok=True)
        cv2.imwrite(str(root / f"depths/{number}.png"), np.rint(disk_depth(at, z) / unit).astype(np.uint16))
        name = {"file_path": f"./images/{number}.png", "depth_file_path": f"depths/{number}.png"}
        frames.append({**name, "transform_matrix": matrix})
    (root / "transforms.json").write_text(json.dumps({**common, "frames": frames}))
    return root
