"""A dive in miniature, in the layout that the colmap dataset reads: written here by hand, changed by each test."""

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

WIDTH = 40
HEIGHT = 30
CAMERA = f"1 PINHOLE {WIDTH} {HEIGHT} 50 60 20.5 14.5"
FORWARD = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # at the world's origin, along its z axis

Image = tuple[str, tuple[float, ...], int]  # name, qw qx qy qz tx ty tz, camera id


def write_model(
    sparse: Path, images: Iterable[Image], cameras: Iterable[str] = (CAMERA,)
) -> None:
    """Write a text model; the points line of every second image is empty, as it is where nothing was matched."""
    sparse.mkdir(parents=True, exist_ok=True)
    (sparse / "cameras.txt").write_text(
        "# a comment\n" + "".join(f"{line}\n" for line in cameras)
    )
    lines = ["# a comment"]
    for number, (name, pose, camera) in enumerate(images, 1):
        lines += [
            f"{number} {' '.join(map(repr, pose))} {camera} {name}",
            "1.5 2.5 -1 3.5 4.5 -1" if number % 2 else "",
        ]
    (sparse / "images.txt").write_text("\n".join(lines) + "\n")
    (sparse / "points3D.txt").write_text("")


def to_binary(sparse: Path) -> None:
    """Turn the text model into the binary one that COLMAP writes of it."""
    import pycolmap

    pycolmap.Reconstruction(sparse).write_binary(sparse)
    for path in sparse.glob("*.txt"):
        path.unlink()


def write_image(path: Path, values: np.ndarray) -> None:
    """Write gray or RGB values; `path` says the format."""
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), values[..., ::-1] if values.ndim == 3 else values)


def picture(seed: int, width: int = WIDTH, height: int = HEIGHT) -> np.ndarray:
    """Return an RGB picture (H, W, 3) uint8 that is mostly noise: cut files lose pixels, swapped channels show."""
    values = np.random.default_rng(seed).integers(0, 100, (height, width, 3), dtype=np.uint8)
    return values + np.array([0, 60, 120], np.uint8)


def write_dive(root: Path, names: Iterable[str] = ("a.png", "b.png")) -> Path:
    """Write images, 16-bit depth maps of 2 m + 1 mm a pixel along x, and a model of them; return the folder."""
    names = list(names)
    write_model(
        root / "sparse",
        [(name, (*FORWARD[:4], float(i), 0.0, 0.0), 1) for i, name in enumerate(names)],
    )
    for seed, name in enumerate(names):
        write_image(root / "images" / name, picture(seed))
        path = root / "depths" / name
        write_image(path.with_name(f"depth_{path.stem}.png"), depth_mm())
    return root


def depth_mm() -> np.ndarray:
    """Return (H, W) uint16 millimetres: 2000 + x, and no depth in the first column."""
    values = np.tile(2000 + np.arange(WIDTH, dtype=np.uint16), (HEIGHT, 1))
    values[:, 0] = 0
    return values
