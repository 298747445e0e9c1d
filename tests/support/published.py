"""Published pictures and weights for checks: read where they lie, beside a folder of the checkout; never copied."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from sucre_bench import Arrays, Restoration, Scene, View
from support.places import DATA


def published(name: str) -> Path:
    """The folder `name` of shared/data, or a skipped test."""
    if (DATA / name).exists():
        return DATA / name
    pytest.skip(f"needs shared/data/{name} beside the checkout")


def read(file: Path) -> np.ndarray:
    """(H, W, 3) float32 RGB in [0, 1]."""
    image = cv2.imread(str(file))
    assert image is not None, file
    return image[..., ::-1].astype(np.float32) / 255


def restored(method: object, rgb: np.ndarray) -> Restoration:
    """What a method makes of one image by itself."""
    view = View("photo.png", Arrays(rgb))
    return method.restore(Scene("alone", [view], frozenset()), view)  # type: ignore[attr-defined]


def psnr_db(image: np.ndarray, other: np.ndarray) -> float:
    """Peak signal-to-noise ratio of images in [0, 1], clipped, dB."""
    return float(-10 * np.log10(np.mean((image.clip(0, 1) - other) ** 2)))
