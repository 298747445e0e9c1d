"""The page of a people's study shows the holes of all methods in each picture: people judge colours."""

import base64
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from support.command_line import run


def first_view(folder: Path, page: Path) -> dict[str, tuple[float, float]]:
    """For each method, the shares of columns that are black, and gray, in its picture of the first view."""
    newest = max((folder / "people").glob("*.json"), key=lambda path: path.stat().st_mtime_ns)
    pictures = json.loads(newest.read_text())["pictures"]
    found = {}
    for name, text in re.findall(r'id="p-(\w+)">([^<]+)<', page.read_text()):
        image = cv2.imdecode(np.frombuffer(base64.b64decode(text), np.uint8), cv2.IMREAD_COLOR)
        if pictures[name]["view"] == "v0.png":
            black = (image.max(axis=(0, 2)) < 25).mean()  # JPEG smears edges
            gray = (np.abs(image.astype(int) - 128).max(axis=(0, 2)) < 6).mean()
            found[pictures[name]["method"]] = (float(black), float(gray))
    return found


def test_pictures_have_the_same_holes(bench: Callable[..., Any], toys: str, tmp_path: Path):
    made = tmp_path / "results"
    run(made, "method=gain,left_half", "left_half.stop=0.75", multirun=True)
    asked = ("study", "results", "--methods", "gain,left_half", "--out")
    assert bench(*asked, "common.html").returncode == 0
    for black, gray in first_view(made, tmp_path / "common.html").values():
        assert black == 0
        assert abs(gray - 0.25) < 0.1
    assert bench(*asked, "own.html", "--pixels", "own").returncode == 0
    own = first_view(made, tmp_path / "own.html")
    assert own["gain"] == (0, 0)
    assert own["left_half"][0] > 0.1


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
