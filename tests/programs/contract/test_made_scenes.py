"""The scenes that plugins are checked on, and what they find changed in the process."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sucre_bench.programs.contract.made_scenes import charted, least, wall
from sucre_bench.programs.contract.process_state import changed, snapshot


def test_the_least_scene_has_what_is_needed_and_nothing_else() -> None:
    view = least(charted(), frozenset({"depth"}))["far.png"]
    assert view.has_depth
    assert (view.camera, view.cam_from_world, view.reference, view.charts) == (None, None, None, ())


def test_both_views_of_the_wall_see_it_at_the_same_place() -> None:
    from sucre_bench.multiview.pairing import lift, match

    scene = wall()
    assert len(match(lift(scene["far.png"]), scene["near.png"]).pixels) > 500


def test_the_painted_charts_are_read_as_what_they_are() -> None:
    from sucre_bench.imaging.charts.reading import measure

    view = charted()["far.png"]
    for chart in view.charts:
        for reading in measure(np.asarray(view.reference), chart):
            np.testing.assert_allclose(reading.rgb, reading.patch.srgb, atol=1e-6)


def test_changes_of_what_is_global_are_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    before = snapshot()
    assert changed(before, snapshot()) == []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SUCRE_BENCH_TRIED", "1")
    assert changed(before, snapshot()) == ["the working directory", "os.environ[SUCRE_BENCH_TRIED]"]
