"""precomputed looks before pictures are scored: what is probably a mistake is said, and nothing of a right folder."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from sucre_bench import Arrays, Scene, View, restore
from sucre_bench.machine import progress
from sucre_bench.methods.doors.precomputed import Precomputed

pytestmark = pytest.mark.short


def photographs(count: int) -> list[np.ndarray]:
    """A textured ground, from a camera that moves by a tenth of a picture."""
    rng = np.random.default_rng(0)
    fields = [
        cv2.resize(
            rng.random((n, n, 3)).astype(np.float32), (600, 600), interpolation=cv2.INTER_CUBIC
        )
        for n in (9, 40)
    ]
    ground = (0.3 + 0.25 * sum(fields)).clip(0, 1)
    return [ground[20 * k : 20 * k + 150, 20 * k : 20 * k + 200] for k in range(count)]


def restored_pictures() -> list[np.ndarray]:
    return [((x - 0.2) * [1.8, 1.3, 1.2]).clip(0.01, 1) ** 0.8 for x in photographs(12)]


def said_of(folder: Path, pictures: list[np.ndarray]) -> list[str]:
    scene = Scene(
        "s", [View(f"{k}.png", Arrays(x)) for k, x in enumerate(photographs(12))], frozenset()
    )
    for k, picture in enumerate(pictures):
        cv2.imwrite(
            str(folder / f"{k}.png"), np.round(picture[..., ::-1] * 255).astype(np.uint8)
        )
    said = list[str]()
    with progress.watched_by(
        lambda event, *values: said.append(values[0]) if event == "said" else None
    ):
        for view in scene.views[: len(pictures)]:
            restore(Precomputed(folder=folder), scene, view)
    return said


def test_right_pictures_are_scored_without_a_word(tmp_path: Path) -> None:
    assert said_of(tmp_path, restored_pictures()) == []


@pytest.mark.parametrize("step", [1, 3])
def test_pictures_numbered_otherwise_than_the_photographs_are_said(
    tmp_path: Path, step: int
) -> None:
    """A renderer numbers the views that it held out, or begins at another number."""
    (line,) = said_of(tmp_path, restored_pictures()[1::step])
    assert f"{tmp_path}: 0.png is more like the photograph 1.png" in line


def test_a_black_block_is_named_with_the_option_that_makes_it_holes(tmp_path: Path) -> None:
    pictures = restored_pictures()
    pictures[0][:60] = 0
    (line,) = said_of(tmp_path, pictures)
    assert "40 % of 0.png is exactly black" in line
    assert ".holes=black" in line


def test_pictures_in_other_formats_are_counted(tmp_path: Path) -> None:
    for name in ("3.heic", "4.JP2"):
        (tmp_path / name).write_bytes(b"no picture")
    (line,) = said_of(tmp_path, restored_pictures()[:2])
    assert "2 pictures" in line
    assert "3.heic" in line
