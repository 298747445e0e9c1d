"""A run decodes each file once, and leaves nothing of it behind."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from support.command_line import but_times

from sucre_bench import results
from sucre_bench.engine.hydra_run import run_words as run
from sucre_bench.loading.view_files import Files

WORDS = [
    "dataset=photos",
    "method=underwater,gray_world",
    "metrics=[negative]",
    "tracking.uri=off",
    "report=false",
]


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    folder = tmp_path / "photos"
    folder.mkdir()
    for n in range(3):
        image = np.random.default_rng(n).integers(0, 256, (300, 400, 3), dtype=np.uint8)
        cv2.imwrite(str(folder / f"{n}.png"), image)
    return folder


@pytest.fixture
def decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], Counter[str]]:
    """The photographs that this process and its workers have decoded since the last call."""
    log, load = tmp_path / "decoded", Files.load
    log.touch()

    def noted(self: Files, plane: str) -> object:
        if plane.endswith("rgb"):
            with log.open("a") as file:
                file.write(f"{self.image.name}\n")
        return load(self, plane)

    def since() -> Counter[str]:
        found = Counter(log.read_text().splitlines())
        log.write_text("")
        return found

    monkeypatch.setattr(Files, "load", noted)
    return since


def _run(out: Path, photos: Path, *words: str) -> None:
    assert (
        run([*WORDS, f"dataset.root={photos}", f"out={out}", *words], multirun=True).exit_code
        == 0
    )


def test_two_methods_decode_an_image_once_with_the_same_scores(
    tmp_path: Path, photos: Path, decoded: Callable[[], Counter[str]]
):
    _run(tmp_path / "shared", photos)
    assert decoded() == {f"{n}.png": 1 for n in range(3)}
    _run(tmp_path / "each", photos, "cache_gb=0")
    assert decoded()["0.png"] == 2
    one, other = (but_times(results.read(tmp_path / name)) for name in ("shared", "each"))
    pd.testing.assert_frame_equal(one, other)


def test_nothing_is_left_but_what_is_asked_to_stay(
    tmp_path: Path, photos: Path, decoded: Callable[[], Counter[str]]
):
    out = tmp_path / "out"
    (out / ".decoded").mkdir(parents=True)
    (out / ".decoded" / "left by a run that was killed.part").write_bytes(b"x")
    _run(out, photos)
    assert not (out / ".decoded").exists()
    _run(out, photos, "cache_keep=true", "overwrite=always")
    assert (out / ".decoded").exists()
    decoded()
    _run(out, photos, "cache_keep=true", "overwrite=always")
    assert not decoded()
