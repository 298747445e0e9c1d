"""A run decodes each file once, and leaves nothing of it behind."""

from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest

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


class Decoded:
    """Which planes were decoded by this process and its workers."""

    def __init__(self, log: Path) -> None:
        self.log = log
        self.clear()

    def clear(self) -> None:
        self.log.write_text("")

    @property
    def counts(self) -> Counter[str]:
        return Counter(self.log.read_text().splitlines())


@pytest.fixture
def decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Decoded:
    noted, load = Decoded(tmp_path / "decoded"), Files.load

    def counted(self: Files, plane: str) -> object:
        with noted.log.open("a") as file:
            file.write(f"{self.image.name} {plane}\n")
        return load(self, plane)

    monkeypatch.setattr(Files, "load", counted)
    return noted


def _run(out: Path, photos: Path, *words: str) -> None:
    assert (
        run([*WORDS, f"dataset.root={photos}", f"out={out}", *words], multirun=True).exit_code
        == 0
    )


def test_two_methods_decode_an_image_once_with_the_same_scores(
    tmp_path: Path, photos: Path, decoded: Decoded
):
    _run(tmp_path / "shared", photos)
    assert {plane: n for plane, n in decoded.counts.items() if plane.endswith("rgb")} == {
        f"{n}.png rgb": 1 for n in range(3)
    }
    decoded.clear()
    _run(tmp_path / "each", photos, "cache_gb=0")
    assert decoded.counts["0.png rgb"] == 2
    one, other = (results.read(tmp_path / name) for name in ("shared", "each"))
    one, other = (
        rows[~rows["metric"].isin(["seconds", "peak_mb"])].reset_index(drop=True)
        for rows in (one, other)
    )
    columns = [
        "scene",
        "view",
        "method",
        "metric",
        "value",
        "n_pixels",
        "coverage",
        "options_id",
        "data_id",
        "code",
    ]
    assert one[columns].equals(other[columns])


def test_nothing_is_left_but_what_is_asked_to_stay(
    tmp_path: Path, photos: Path, decoded: Decoded
):
    out = tmp_path / "out"
    (out / ".decoded").mkdir(parents=True)
    (out / ".decoded" / "left by a run that was killed.part").write_bytes(b"x")
    _run(out, photos)
    assert not (out / ".decoded").exists()
    _run(out, photos, "cache_keep=true", "overwrite=always")
    assert (out / ".decoded").exists()
    decoded.clear()
    _run(out, photos, "cache_keep=true", "overwrite=always")
    assert not decoded.counts["0.png rgb"]
