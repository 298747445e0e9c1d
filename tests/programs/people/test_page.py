"""The page of a people's study shows the pixels that all methods fill, so that holes do not tell methods apart."""

import base64
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from support.command_line import run


def black_columns(folder: Path, page: Path) -> dict[str, np.ndarray]:
    """For each method, which columns of its picture of the first view are black."""
    newest = max((folder / "people").glob("*.json"), key=lambda path: path.stat().st_mtime_ns)
    pictures = json.loads(newest.read_text())["pictures"]
    found = {}
    for name, text in re.findall(r'id="p-(\w+)">([^<]+)<', page.read_text()):
        image = cv2.imdecode(np.frombuffer(base64.b64decode(text), np.uint8), cv2.IMREAD_COLOR)
        if pictures[name]["view"] == "v0.png":
            found[pictures[name]["method"]] = (image.max(axis=(0, 2)) < 25).mean()  # JPEG smears edges
    return found


@pytest.fixture
def results_folder(toys: str, tmp_path: Path) -> Path:
    run(tmp_path / "results", "method=gain,left_half,middle", "left_half.stop=0.75", "report=false", multirun=True)
    return tmp_path / "results"


def test_all_pictures_of_a_view_have_the_same_holes(bench: Callable[..., Any], results_folder: Path, tmp_path: Path):
    asked = ("study", "results", "--methods", "gain,left_half,middle", "--out")
    assert bench(*asked, "common.html").returncode == 0
    common = black_columns(results_folder, tmp_path / "common.html")
    assert len(common) == 3
    assert len(set(common.values())) == 1
    assert bench(*asked, "own.html", "--pixels", "own").returncode == 0
    own = black_columns(results_folder, tmp_path / "own.html")
    assert own["gain"] == 0 < own["left_half"] < common["gain"]


def test_methods_that_share_no_pixel_are_named_and_can_be_shown_on_their_own(
    bench: Callable[..., Any], toys: str, tmp_path: Path
):
    run(tmp_path / "results", "method=left_half,right_half", "report=false", multirun=True)
    asked = ("study", "results", "--methods", "left_half,right_half", "--out", "study.html")
    refused = bench(*asked)
    assert refused.returncode == 2
    assert "v0.png" in refused.stderr
    assert "--pixels own" in refused.stderr
    assert bench(*asked, "--pixels", "own").returncode == 0
