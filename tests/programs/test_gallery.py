"""`sucre-bench gallery`, on a repository laid out as a published one."""

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest
from PIL import Image
from skimage.metrics import peak_signal_noise_ratio

from sucre_bench.machine import progress
from sucre_bench.programs.gallery import compared, exhibits, lay_out
from sucre_bench.results import published

Bench = Callable[..., Any]


@pytest.fixture
def repositories(tmp_path: Path) -> Path:
    """MLLE's repository with a made photograph, and a published output 10 levels brighter."""
    images = tmp_path / "repositories" / "MMLE_code" / "2022-MLLE" / "Image"
    (images / "result").mkdir(parents=True)
    photograph = np.random.default_rng(0).integers(60, 120, (6, 8, 3), dtype=np.uint8)
    photograph = cv2.resize(photograph, (96, 72), interpolation=cv2.INTER_CUBIC)
    cv2.imwrite(str(images / "7.jpg"), photograph)
    cv2.imwrite(str(images / "result" / "7_MLLE.jpg"), photograph + 10)
    return tmp_path / "repositories"


def test_the_agreement_of_rows_with_published_pictures_is_written_and_on_the_page(
    bench: Bench, repositories: Path, tmp_path: Path
) -> None:
    done = bench("gallery", str(repositories), "out", "--only", "mlle,haam_gan")
    assert done.returncode == 0, done.stderr
    assert "git clone --depth 1 https://github.com/zhoujingchun03/HAAM-GAN" in done.stderr
    out = tmp_path / "out"
    with (out / "tables" / "gallery-published.csv").open(encoding="utf-8") as file:
        lines = {line["row"]: line for line in csv.DictReader(file)}
    images = repositories / "MMLE_code" / "2022-MLLE" / "Image"
    photograph, output = (cv2.imread(str(images / name)) for name in ("7.jpg", "result/7_MLLE.jpg"))
    expected = peak_signal_noise_ratio(photograph, output)
    assert float(lines["underwater"]["measured"]) == pytest.approx(expected, abs=1e-3)
    page = (out / "report" / "index.html").read_text(encoding="utf-8")
    assert "Published against measured" in page
    assert lines["mlle"]["measured"] in page
    again = bench("run", str(out / "pictures" / "mlle" / "lineup.yaml"), "out=again", "tracking.uri=off")
    assert again.returncode == 0, again.stderr


def test_a_file_that_changed_in_its_repository_or_was_half_copied_is_taken_again(repositories: Path, tmp_path: Path):
    (exhibit,) = exhibits(["mlle"])
    source, out = repositories / "MMLE_code/2022-MLLE/Image/7.jpg", tmp_path / "out"
    target = lay_out(exhibit, repositories, out).parent / "photographs" / "7.jpg"
    target.unlink()
    target.write_bytes(source.read_bytes()[:100])
    lay_out(exhibit, repositories, out)
    assert target.read_bytes() == source.read_bytes()
    cv2.imwrite(str(tmp_path / "new.jpg"), np.full((72, 96, 3), 90, np.uint8))
    (tmp_path / "new.jpg").replace(source)
    lay_out(exhibit, repositories, out)
    assert target.read_bytes() == source.read_bytes()


def test_pictures_agree_after_the_loss_of_jpeg_unless_one_is_damaged(tmp_path: Path, capsys):
    """The published pictures are the row's own, stored as JPEG: equal ones are at most 100 dB apart."""
    (exhibit,), ours = exhibits(["fuse_uwnet"]), tmp_path / "restored" / "fuse_uwnet" / "Fuse-UWnet_onnx"
    theirs = tmp_path / "pictures" / "fuse_uwnet" / "Fuse-UWnet"
    ours.mkdir(parents=True)
    theirs.mkdir(parents=True)
    picture = np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)
    for name, sampling in (("full", 0), ("half", 2), ("damaged", 2)):
        Image.fromarray(picture).save(ours / f"{name}.png")
        Image.fromarray(picture).save(theirs / f"{name}.jpg", quality=90, subsampling=sampling)
    (theirs / "damaged.jpg").write_bytes(b"\xff\xd8\xff")
    rows = pd.DataFrame({"dataset": [exhibit.name], **dict.fromkeys(["method", "metric", "variant", "status"], "")})
    with progress.live():
        (line,) = compared(rows.assign(view="", region="", value=0.0), tmp_path).to_dict("records")
    assert (line["views"], float(line["measured"])) == (2, 100)
    assert "damaged.jpg" in capsys.readouterr().err


@pytest.mark.parametrize("content", [b"image,psnr\na.png,26.3\n", "café\n".encode("cp1252")])
def test_a_table_of_others_is_not_taken_for_the_gallerys(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "tables").mkdir()
    (tmp_path / published.FILE).write_bytes(content)
    assert published.read(tmp_path) == []


def test_a_folder_without_any_of_the_repositories_is_refused(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    done = bench("gallery", "empty", "out", "--only", "mlle")
    assert done.returncode == 2
    assert "git clone" in done.stderr
