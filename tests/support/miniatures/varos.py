"""A VAROS dive in miniature."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from support.colmap_folder import picture, write_image

WIDTH, HEIGHT = 32, 18
CAMERA = "focal_length: 30.0\nsensor_width: 32.0\nsensor_height: 24.0\nresolution:\n  width: 32\n  height: 18\n"
HEADER = "# timestamp [ns],r11,r12,r13,s_x_vw [m],r21,r22,r23,s_y_vw [m],r31,r32,r33,s_z_vw [m]"
POSE_FILE = "camM0_poses/camM0_poses_transformation_matrix.csv"
# Camera to world, looking along +z. Frame 7: at the origin. Frame 8: at (5, 0, 10), looking along the world's -x.
POSES = {7: "1,0,0,0, 0,1,0,0, 0,0,1,0", 8: "0,0,-1,5, 0,1,0,0, 1,0,0,10"}


def metres(value: float) -> int:
    return round(value / 25 * 65535)


def write_dive(cam: Path, camera: str = CAMERA, sub: str = "") -> Path:
    """Two frames whose only near depth is at the point above."""
    marks = {7: (19, 12), 8: (16, 16)}  # column, row: 30 x / z + 16, 30 y / z + 9
    for frame, depth in ((7, 10.0), (8, 4.0)):
        for plane in "AB":
            shown = picture(frame + (plane == "B"), WIDTH, HEIGHT)
            write_image(cam / plane / sub / f"seq01_veh0_camM0_{plane}-{frame:08d}.png", shown)
        values = np.full((HEIGHT, WIDTH), 65535, np.uint16)
        values[3, 5] = metres(20.0)
        column, row = marks[frame]
        values[row, column] = metres(depth)
        write_image(cam / "D" / sub / f"seq01_veh0_camM0_D-{frame:08d}.png", values)
    (cam / "camM0.yaml").write_text(camera)
    (cam / "camM0_timestamps.csv").write_text(
        "#timestamp [ns],A,B,C,D\n"
        + "".join(
            f"{100_000_000 * frame},{','.join(f'seq01_veh0_camM0_{p}-{frame:08d}.png' for p in 'ABCD')}\n"
            for frame in (7, 8)
        )
    )
    rows = "".join(f"{100_000_000 * frame + 4_999_936},{POSES[frame]}\n" for frame in (8, 7))
    (cam / "camM0_poses").mkdir()
    (cam / POSE_FILE).write_text(f"{HEADER}\n{rows}")
    return cam
