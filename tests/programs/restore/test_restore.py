"""sucre-bench restore: whole pictures for use, of photographs and of a dive."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from support.colmap_folder import picture, write_dive, write_image
from support.command_line import Done
from support.photographed_valley import NAMES, POSES, photograph

Bench = Callable[..., Done]


def seabed(seed: int, height: int = 60, width: int = 80) -> np.ndarray:
    values = cv2.resize(picture(seed, 20, 15), (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(values)


def contents(folder: Path) -> dict[str, bytes]:
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def test_single_photographs_come_back_under_their_names_and_a_damaged_one_costs_itself(tmp_path: Path, bench: Bench):
    photos, out = tmp_path / "photos", tmp_path / "out"
    write_image(photos / "day 1/a.JPG", seabed(0))
    write_image(photos / "day 1/a.png", (seabed(1).astype(np.uint16) << 8) + 7)
    write_image(photos / "b.tif", seabed(2))
    (photos / "c.jpg").write_bytes((photos / "day 1/a.JPG").read_bytes()[:600])
    before = contents(photos)
    done = bench("restore", "photos", "out", "--method", "gray_world")
    assert done.returncode == 1
    assert "c.jpg" in done.stdout
    assert "3 of 4 pictures" in done.stdout
    made = contents(out / "pictures")
    assert sorted(made) == ["b.tif", "day 1/a.JPG", "day 1/a.png"]
    for name, form in (("b.tif", "TIFF"), ("day 1/a.JPG", "JPEG"), ("day 1/a.png", "PNG")):
        with Image.open(out / "pictures" / name) as image:
            assert (image.format, image.size) == (form, (80, 60))
    deep = cv2.imread(str(out / "pictures/day 1/a.png"), cv2.IMREAD_UNCHANGED)
    assert deep.dtype == np.uint16
    assert len(np.unique(deep)) > 256
    means = cv2.imread(str(out / "pictures/b.tif")).mean(axis=(0, 1))
    assert np.ptp(means) < 2, "the photographs are blue, a gray world is not"
    with Image.open(out / "contact-sheet.jpg") as sheet:
        assert sheet.width > 600
    assert contents(photos) == before

    times = {name: (out / "pictures" / name).stat().st_mtime_ns for name in made if name != "b.tif"}
    (out / "pictures/b.tif").unlink()
    assert bench("restore", "photos", "out", "--method", "gray_world").returncode == 1
    assert {name: (out / "pictures" / name).stat().st_mtime_ns for name in times} == times, "nothing is done twice"
    assert contents(out / "pictures") == made


def test_a_dive_is_whole_in_the_formats_of_its_photographs(tmp_path: Path, bench: Bench) -> None:
    """The dive as `prepare` leaves it: undistorted PNG of distorted JPEG, depth with holes, one photograph unplaced."""
    dive, photos = write_dive(tmp_path / "dive", ("a.png", "b.png")), tmp_path / "photos"
    for seed, name in enumerate(("a.jpg", "b.jpg", "c.jpg")):
        write_image(photos / name, picture(seed))
    parameters = {"model": "SIMPLE_RADIAL", "width": 40, "height": 30, "params": [48.0, 20.5, 14.5, -0.02]}
    (dive / "prepare.json").write_text(json.dumps({"photos": str(photos), "cameras": {"1": parameters}}))
    done = bench("restore", "dive", "out", "--method", "dive_gray_world", "method.fewest=10")
    assert done.returncode == 0, done.stderr
    assert "3 of 3 pictures" in done.stdout
    assert "1 photograph" in done.stdout
    assert sorted(contents(tmp_path / "out/pictures")) == ["a.jpg", "b.jpg", "c.jpg"]
    for name in ("a.jpg", "b.jpg"):
        first_column = cv2.imread(str(tmp_path / "out/pictures" / name))[:, 0]
        assert (first_column.max(axis=-1) > 20).mean() > 0.9, "pixels without depth are no holes"
    blocks = ("restore", "dive", "blocks", "--method", "dive_gray_world", "method.fewest=10", "shard.count=2")
    assert bench(*blocks, "workers=0").returncode == 0
    assert contents(tmp_path / "blocks/pictures") == contents(tmp_path / "out/pictures")


BROKEN = """
from dataclasses import dataclass
from sucre_bench import Restoration, Scene, View, method


@method(needs={"depth"}, cites="nobody")
@dataclass(frozen=True)
class Broken:
    \"\"\"Fail.\"\"\"

    def restore(self, scene: Scene, view: View) -> Restoration:
        raise ValueError("no light at all")
"""


def test_a_method_that_fails_is_named_with_the_one_that_replaced_it(tmp_path: Path, bench: Bench) -> None:
    write_dive(tmp_path / "dive", ("a.png", "b.png"))
    (tmp_path / "broken.py").write_text(BROKEN)
    words = ("--plugin", "broken.py", "--method", "broken", "--single-view", "gray_world")
    done = bench("restore", "dive", "out", *words)
    assert done.returncode == 1
    assert sorted(contents(tmp_path / "out/pictures")) == ["a.png", "b.png"]
    assert all(text in done.stdout for text in ("broken", "2 photographs", "gray_world", "no light at all"))
    assert "without a place" not in done.stdout


@pytest.mark.parametrize("out", ["photos", "photos/restored", ".", "other", "photos/a.png"])
def test_photographs_and_files_of_others_are_safe(tmp_path: Path, bench: Bench, out: str) -> None:
    write_image(tmp_path / "photos/a.png", seabed(0))
    write_image(tmp_path / "other/mine.png", seabed(1))
    before = contents(tmp_path)
    done = bench("restore", "photos", out, "--method", "gray_world")
    assert done.returncode == 2
    assert len(done.errors) == 1
    assert "; " in done.errors[0]
    assert contents(tmp_path) == before


def test_out_of_other_photographs_is_refused_and_other_options_write_again(tmp_path: Path, bench: Bench) -> None:
    for folder in ("photos", "more"):
        write_image(tmp_path / folder / "a.jpg", seabed(len(folder)))
    assert bench("restore", "photos", "out", "--method", "gray_world").returncode == 0
    first = contents(tmp_path / "out/pictures")
    assert bench("restore", "more", "out", "--method", "gray_world").returncode == 2
    assert contents(tmp_path / "out/pictures") == first
    assert bench("restore", "photos", "out", "--method", "gray_world", "--quality", "40").returncode == 0
    assert len(contents(tmp_path / "out/pictures")["a.jpg"]) < len(first["a.jpg"])


@pytest.mark.parametrize("word", ["out=here", "first=1", "sucre.fill=true"])
def test_a_word_that_is_no_option_of_dataset_or_method_is_refused(tmp_path: Path, bench: Bench, word: str) -> None:
    write_image(tmp_path / "photos/a.jpg", seabed(0))
    done = bench("restore", "photos", "out", "--method", "gray_world", word)
    assert done.returncode == 2
    assert word in done.errors[0]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("word", ["workers=-1", "workers=abc", *(f"shard.count={n}" for n in ("-2", "0", "1,2", "x"))])
def test_a_number_of_workers_or_blocks_that_is_none_is_refused(tmp_path: Path, bench: Bench, word: str) -> None:
    write_image(tmp_path / "photos/a.jpg", seabed(0))
    (line,) = bench("restore", "photos", "out", "--method", "gray_world", word).errors
    assert word in line
    assert "shard.index" not in line


def test_photographs_that_overlap_are_prepared_and_restored_together(tmp_path: Path, bench: Bench) -> None:
    names = NAMES[:4]
    for name, pose in zip(names, POSES[:4], strict=True):
        write_image(tmp_path / "photos" / name, photograph(pose))
    words = ("restore", "photos", "out", "--method", "dive_gray_world", "--original-geometry")
    done = bench(*words)
    assert done.returncode == 0, done.stderr
    assert "4 of 4 pictures" in done.stdout
    assert sorted(contents(tmp_path / "out/pictures")) == sorted(names)
    for name in names:  # edges lie where the distorting camera saw them
        before, after = (cv2.imread(str(tmp_path / folder / name), 0) for folder in ("photos", "out/pictures"))
        (x, y), _ = cv2.phaseCorrelate(*(cv2.Laplacian(one.astype(np.float32), cv2.CV_32F) for one in (before, after)))
        assert np.hypot(x, y) < 0.3
    first = (tmp_path / "out/pictures" / NAMES[0]).stat().st_mtime_ns
    assert bench(*words).returncode == 0
    assert (tmp_path / "out/pictures" / NAMES[0]).stat().st_mtime_ns == first, "nothing is done twice"
