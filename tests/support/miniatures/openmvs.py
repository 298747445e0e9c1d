"""An OpenMVS scene in miniature."""

from __future__ import annotations

import struct
from pathlib import Path

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

K = np.array([[210.0, 0, 77.25], [0, 190.0, 61.5], [0, 0, 1]])  # pixel centres at whole numbers, as OpenMVS has them
METRES = 0.4  # in a unit of the reconstruction


def dmap(
    image: str,
    K: np.ndarray,
    pose: np.ndarray,
    depth: np.ndarray,
    magic: bytes = b"DR",
    flags: int = 15,
    views: int = 3,
) -> bytes:
    """Pack a depth map; `pose` is world-from-camera."""
    height, width = depth.shape
    exponent = 3 if magic == b"D2" else 0
    head = magic + struct.pack("<Bb4I2f", flags, exponent, WIDTH, HEIGHT, width, height, 0.5, 20.0)
    if magic == b"D2":
        head += struct.pack("<f", 1.0)
    head += struct.pack("<H", len(image.encode())) + image.encode() + struct.pack(f"<I{views}I", views, *range(views))
    head += struct.pack("<21d", *K.ravel(), *pose[:3, :3].T.ravel(), *pose[:3, 3])
    stored = (depth / 2**exponent).astype("<f2") if magic == b"D2" else depth.astype("<f4")
    return head + stored.tobytes() + bytes(16 * depth.size)  # normals and confidence, which are not ours to read


def write_scene(root: Path, magic: bytes = b"DR", step: int = 1, name: str = "images/{}.jpg") -> Path:
    """Two images with a spot, in units of the reconstruction: lengths are divided by METRES."""
    for number, (where, turn) in enumerate(BOTH):
        pose = pose_of(where, turn)
        at = (K @ seen(pose))[:2] / seen(pose)[2]
        write_spot(root / f"images/{number}.png", at + 0.5)
        coarse = disk_depth((at + 0.5) / step, seen(pose)[2] / METRES, (WIDTH // step, HEIGHT // step))
        pose[:3, 3] /= METRES
        content = dmap(name.format(number), K, pose, coarse, magic)
        (root / f"depth{number:04}.dmap").write_bytes(content)
    return root
