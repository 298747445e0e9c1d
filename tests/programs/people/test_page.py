"""The page of a people's study shows no holes: people judge colours."""

import base64
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from support.command_line import run


def first_view(folder: Path, page: Path) -> dict[str, tuple[tuple[int, ...], float]]:
    """For each method, the shape of its picture of the first view, and the share of its columns that are black."""
    newest = max((folder / "people").glob("*.json"), key=lambda path: path.stat().st_mtime_ns)
    pictures = json.loads(newest.read_text())["pictures"]
    found = {}
    for name, text in re.findall(r'id="p-(\w+)">([^<]+)<', page.read_text()):
        image = cv2.imdecode(np.frombuffer(base64.b64decode(text), np.uint8), cv2.IMREAD_COLOR)
        if pictures[name]["view"] == "v0.png":
            black = (image.max(axis=(0, 2)) < 25).mean()  # JPEG smears edges
            found[pictures[name]["method"]] = (image.shape, float(black))
    return found


def test_no_picture_shows_holes(bench: Callable[..., Any], toys: str, tmp_path: Path):
    made = tmp_path / "results"
    run(made, "method=gain,left_half,middle", "left_half.stop=0.75", multirun=True)
    asked = ("study", "results", "--methods", "gain,left_half,middle", "--out")
    assert bench(*asked, "common.html").returncode == 0
    common = first_view(made, tmp_path / "common.html")
    assert len(common) == 3
    assert len(set(common.values())) == 1
    assert bench(*asked, "own.html", "--pixels", "own").returncode == 0
    own = first_view(made, tmp_path / "own.html")
    assert common["gain"][1] == own["gain"][1] == 0 < own["left_half"][1]
    assert common["gain"][0][1] < own["gain"][0][1]  # cropped


def test_a_method_that_fills_next_to_nothing_is_left_out_and_named(
    bench: Callable[..., Any], toys: str, tmp_path: Path
):
    methods = "gain,left_half,middle"
    run(tmp_path / "results", f"method={methods}", "left_half.stop=0.1", multirun=True)
    made = bench("study", "results", "--methods", methods, "--out", "study.html")
    assert made.returncode == 0
    assert "left_half" in made.stdout
    assert set(first_view(tmp_path / "results", tmp_path / "study.html")) == {"gain", "middle"}


def test_methods_that_share_no_pixel_are_named_and_can_be_shown_on_their_own(
    bench: Callable[..., Any], toys: str, tmp_path: Path
):
    run(tmp_path / "results", "method=left_half,right_half", multirun=True)
    asked = ("study", "results", "--methods", "left_half,right_half", "--out", "study.html")
    refused = bench(*asked)
    assert refused.returncode == 2
    assert "v0.png" in refused.stderr
    assert "--pixels own" in refused.stderr
    assert bench(*asked, "--pixels", "own").returncode == 0
