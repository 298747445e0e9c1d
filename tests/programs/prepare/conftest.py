"""What the tests of preparing share."""

from pathlib import Path

import numpy as np
import pytest
from support.photographed_valley import HEIGHT, NAMES, POSES, WIDTH, photograph, write


@pytest.fixture(scope="session")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six photos of the planes, one of something else, one cut short; and masks that leave out a corner."""
    root = tmp_path_factory.mktemp("photos")
    for name, pose in zip(NAMES, POSES, strict=True):
        write(root / "photos" / name, photograph(pose))
    write(
        root / "photos" / "else.png",
        np.random.default_rng(0).integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8),
    )
    (root / "photos" / "cut.png").write_bytes((root / "photos" / NAMES[0]).read_bytes()[:9000])
    mask = np.full((HEIGHT, WIDTH), 255, np.uint8)
    mask[:45, :60] = 0
    for name in (*NAMES, "else.png", "cut.png"):
        write(root / "masks" / f"{name}.png", mask)
    return root
