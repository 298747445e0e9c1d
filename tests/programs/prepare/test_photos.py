"""Photos and masks to prepare: too few, damaged, sharing nothing, or in the way of the result."""

import re
from pathlib import Path

import numpy as np
import pytest
from support.photographed_valley import HEIGHT, POSES, photograph, write

from sucre_bench.errors import InputError
from sucre_bench.programs.prepare import Options
from sucre_bench.programs.prepare.photos import find_photos
from sucre_bench.programs.prepare.pipeline import prepare


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ((), r"no photos; .*two"),
        (("a.png",), r"one photo; .*two"),
        (("a.png", "text.jpg"), r"one photo .*\(text\.jpg .*image\); .*two"),
        (("cut.jpg", "text.png"), r"no photos .*\(cut\.jpg .*truncated.*; text\.png .*\); .*two"),
        (("a.png", "cut.png"), r"one photo .*\(cut\.png .*cut.*\); .*two"),
        (("cut.png", "cut.jpg", "cut 2.jpg"), r"no photos .*\(cut 2\.jpg .*; cut\.png .*\); .*two"),
    ],
)
def test_too_few_photos_are_an_error_that_names_the_damaged(tmp_path: Path, names: tuple[str, ...], message: str):
    (tmp_path / "photos").mkdir()
    for name in names:
        file = tmp_path / "photos" / name
        write(file, photograph(POSES[0]))
        if not name.startswith("a"):
            file.write_bytes(b"no image" if name.startswith("text") else file.read_bytes()[:1000])
    with pytest.raises(InputError, match=message):
        prepare(tmp_path / "photos", tmp_path / "out")
    assert not (tmp_path / "out" / "images").exists()


def test_photos_that_share_nothing_are_named_with_what_they_share(tmp_path: Path):
    for seed in range(2):
        noise = np.random.default_rng(seed).integers(0, 255, (120, 160, 3), dtype=np.uint8)
        write(tmp_path / "photos" / f"{seed}.png", noise)
    with pytest.raises(InputError, match=r"/photos: .*\b30\b"):
        prepare(tmp_path / "photos", tmp_path / "out")


def test_a_folder_that_is_not_ours_is_left_alone(photos: Path, tmp_path: Path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(InputError, match=f"^{re.escape(str(tmp_path))}: "):
        prepare(photos / "photos", tmp_path)
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("thesis.txt", "mine")]


@pytest.mark.parametrize("out", [".", "images"])
def test_photos_in_the_way_of_the_result_are_left_alone(tmp_path: Path, out: str):
    (tmp_path / out / ".prepare").mkdir(parents=True)  # as of an earlier command
    for name in ("a.png", "b.png"):
        write(tmp_path / "images" / name, photograph(POSES[0]))
    with pytest.raises(InputError, match=f"^{re.escape(str(tmp_path / out))}: "):
        prepare(tmp_path / "images", tmp_path / out)
    assert sorted(path.name for path in (tmp_path / "images").glob("*.png")) == ["a.png", "b.png"]


def test_a_mask_that_is_missing_or_of_another_shape_is_named(photos: Path, tmp_path: Path):
    (tmp_path / "masks").mkdir()
    with pytest.raises(InputError, match=r"cut\.png\.png: "):
        prepare(photos / "photos", tmp_path / "out", Options(masks=tmp_path / "masks"))
    write(tmp_path / "masks" / "cut.png", np.zeros((HEIGHT, HEIGHT), np.uint8))
    with pytest.raises(InputError, match=r"cut\.png: .*240x240, .*320x240; "):
        prepare(photos / "photos", tmp_path / "out", Options(masks=tmp_path / "masks"))


def test_masks_among_the_photos_are_no_photos_and_bitmaps_are(tmp_path: Path):
    for name in ("a.png", "b.bmp", "c.webp"):
        write(tmp_path / name, np.zeros((24, 32, 3), np.uint8))
        write(tmp_path / "masks" / f"{name}.png", np.full((24, 32), 255, np.uint8))
    found, damaged = find_photos(tmp_path, tmp_path / "masks", 0, tmp_path / "out")
    assert [photo.name for photo in found] == ["a.png", "b.bmp", "c.webp"]
    assert not damaged
