"""Where the repository and the toy plugins lie, and published data that some tests read where they are at hand."""

from __future__ import annotations

import csv
import os
import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
TOYS = Path(__file__).with_name("toy_plugins.py")


def _data() -> Path:
    """The folder that SUCRE_BENCH_DATA names, or shared/data in the checkout, beside it or beside a folder above it."""
    if named := os.environ.get("SUCRE_BENCH_DATA"):
        return Path(named)
    beside = [folder / "shared" / "data" for folder in (ROOT, *ROOT.parents)]
    return next((folder for folder in beside if folder.is_dir()), beside[1])


DATA = _data()


def blocks(page: str, language: str) -> list[str]:
    """The blocks of code in a page of the repository, continued lines joined. language: a pattern."""
    text = re.sub(r"\\\n\s*", "", (ROOT / page).read_text(encoding="utf-8"))
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)


def write_experiments(folder: Path) -> None:
    """Write the first documented experiment by the names that examples give it."""
    shown, *_ = blocks("docs/run.md", "yaml")
    for name in ("my_experiment.yaml", "results/experiment.yaml", "mine/experiment/NAME.yaml"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(shown, encoding="utf-8")


def published(name: str) -> Path:
    """The folder `name` of shared/data, or a skipped test."""
    if (DATA / name).exists():
        return DATA / name
    pytest.skip(
        f"needs {name} in the folder that SUCRE_BENCH_DATA names, or in shared/data beside the checkout"
    )


def read(file: Path) -> np.ndarray:
    """(H, W, 3) float32 RGB in [0, 1]."""
    image = cv2.imread(str(file))
    assert image is not None, file
    return image[..., ::-1].astype(np.float32) / 255


def psnr_db(image: np.ndarray, other: np.ndarray) -> float:
    """Peak signal-to-noise ratio of images in [0, 1], clipped, dB."""
    return float(-10 * np.log10(np.mean((image.clip(0, 1) - other) ** 2)))


@dataclass(frozen=True)
class U45Row:
    """A picture of the publication U45, and the scores that it gives for it."""

    path: Path
    uciqe: float
    uiqm: float
    uicm: float
    uiconm: float
    uism: float


def u45_rows() -> list[U45Row]:
    """Every published picture that is at hand, or a skipped test."""
    folder = published("u45_published")
    with (folder / "published.csv").open() as lines:
        return [
            U45Row(
                folder / row.pop("method") / row.pop("image"),
                **{name: float(value) for name, value in row.items()},
            )
            for row in csv.DictReader(lines)
        ]
