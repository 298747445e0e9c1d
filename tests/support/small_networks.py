"""A small image, restored by the published networks with made weights."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch

from sucre_bench import Arrays, Scene, View, restore

NOISE = np.random.default_rng(0).random((20, 24, 3), dtype=np.float32)
OWN_SIZE = {"water_net": {}, "funie_gan": {"size": None}, "tacl": {}}


def restored(method: str, rgb: np.ndarray, **options: Any) -> np.ndarray:
    view = View("a.png", Arrays(rgb))
    return restore(method, Scene("s", [view], frozenset()), view, **options).image


def saved(path: Path, state: dict[str, Any]) -> Path:
    torch.save(state, path)
    return path


def planes(rgb: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(rgb.astype(np.float64).transpose(2, 0, 1)[None].copy())


def picture(x: torch.Tensor) -> np.ndarray:
    return x[0].numpy().transpose(1, 2, 0)
