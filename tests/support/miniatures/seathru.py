"""A set of the Sea-thru data in miniature."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tifffile

from support.colmap_folder import write_image

WIDTH, HEIGHT = 60, 40


def picture16(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 65536, (HEIGHT, WIDTH, 3), dtype=np.uint16)


def write_set(place: Path, stems: tuple[str, ...] = ("T_S01", "T_S02"), folder: str = "depth") -> Path:
    """Images, and depth maps at half their size: 2 m, and 3 m + 1 m a row in the right half."""
    for seed, stem in enumerate(stems):
        write_image(place / "linearPNG" / f"{stem}.png", picture16(seed))
        depth = np.full((HEIGHT // 2, WIDTH // 2), 2, np.float32)
        depth[:, WIDTH // 4 :] = 3 + np.arange(HEIGHT // 2)[:, None]
        depth[0, 0] = 0
        (place / folder).mkdir(exist_ok=True)
        tifffile.imwrite(place / folder / f"depth{stem}.tif", depth)
    return place
