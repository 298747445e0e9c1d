import io
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """Pictures and references that differ by 16 levels everywhere: PSNR = 20 log10(255 / 16)."""
    images, truth = tmp_path / "images", tmp_path / "truth"
    rng = np.random.default_rng(0)
    for name in ("a.png", "sub/b.png"):
        reference = rng.integers(0, 239, (64, 96, 3), dtype=np.uint8)
        for folder, picture in ((images, reference + 16), (truth, reference)):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(folder / name), picture)
    return images, truth


def scores(text: str) -> pd.DataFrame:
    return pd.read_json(io.StringIO(text))


@pytest.fixture
def psnr(bench, folders):
    """A command that scores the pictures against the references by PSNR."""
    return lambda *words: bench(
        "score", str(folders[0]), "--reference", str(folders[1]), "--metrics", "psnr", *words
    )


def test_a_folder_is_scored_against_references_of_the_same_names(psnr):
    done = psnr("--json")
    assert done.returncode == 0
    rows = scores(done.stdout)
    of_psnr = rows[rows["metric"] == "psnr"]
    assert sorted(of_psnr["view"]) == ["a.png", "sub/b.png"]
    assert of_psnr["value"].astype(float).tolist() == pytest.approx(
        [20 * np.log10(255 / 16)] * 2, abs=1e-3
    )


def test_without_a_choice_every_variant_of_what_applies_is_scored(bench, folders):
    rows = scores(bench("score", str(folders[0]), "--json").stdout)
    variants = rows.groupby("metric")["variant"].nunique()
    assert set(variants.index) == {"uciqe", "uiqm", "uicm", "uism", "uiconm", "saturated_red"}
    assert variants.drop("saturated_red").min() >= 5
    compared = bench("score", "images", "--reference", "truth", "--json").stdout
    of_references = {"psnr", "ssim", "colours", "colours_de00"}
    assert set(scores(compared)["metric"]) == of_references | set(variants.index)


@pytest.mark.parametrize(
    ("of", "change", "named"),
    [
        ("images", lambda path: path.write_bytes(b"not a picture"), r"images/a\.png: "),
        ("truth", Path.unlink, r"truth/a\.png: "),
        ("truth", lambda path: cv2.imwrite(str(path), np.zeros((10, 10))), "96x64, .*10x10"),
    ],
    ids=["unreadable", "no reference", "of another size"],
)
def test_what_cannot_be_scored_is_named_and_the_others_are_scored(
    psnr, folders, of: str, change: Callable[[Path], object], named: str
):
    change(folders[0].with_name(of) / "a.png")
    done = psnr("--json")
    assert done.returncode == 1
    assert re.search(named, done.stderr)
    assert (scores(done.stdout)["metric"] == "psnr").sum() == 1


def test_a_folder_of_other_names_is_one_line(psnr, folders):
    _, truth = folders
    for n, path in enumerate(sorted(truth.rglob("*.png"))):
        path.rename(truth / f"other{n}.png")
    done = psnr()
    assert done.returncode == 2
    assert len(done.errors) == 1
    assert done.errors[0].startswith(f"error: {truth}")


def test_references_of_a_results_folder_are_found_by_stem_and_said_to_be_lossy(
    bench, folders, tmp_path: Path
):
    """Their suffix is .jpg, and they lie in a folder of the dataset."""
    references = tmp_path / "references" / "demo"
    references.mkdir(parents=True)
    cv2.imwrite(
        str(references / "a.jpg"),
        cv2.imread(str(folders[1] / "a.png")),
        [cv2.IMWRITE_JPEG_QUALITY, 100],
    )
    done = bench("score", "images/a.png", "--reference", "references", "--metrics", "psnr")
    assert (done.returncode, done.stderr.count("JPEG")) == (0, 1)
    assert "psnr" in done.stdout


@pytest.mark.parametrize("of", [0, 1], ids=["picture", "reference"])
def test_a_black_block_where_the_other_picture_has_light_is_said(psnr, folders, of):
    path = folders[of] / "a.png"
    picture = cv2.imread(str(path))
    assert "black" not in psnr().stderr
    picture[:20] = 0
    cv2.imwrite(str(path), picture)
    (line,) = [line for line in psnr().stderr.splitlines() if "black" in line]
    assert f"{folders[of]}: 31 % of a.png" in line


def test_references_of_other_images_are_said(psnr, folders):
    assert "own" not in psnr().stderr
    first, second = (folders[1] / name for name in ("a.png", "sub/b.png"))
    first.rename(folders[1] / "kept.png")
    second.rename(first)
    (folders[1] / "kept.png").rename(second)
    (line,) = [line for line in psnr().stderr.splitlines() if "own" in line]
    assert "2 of 2 images" in line
    assert "a.png like that of sub/b.png" in line
