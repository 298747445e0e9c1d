"""The scenes that plugins are checked on, and what they find changed in the process."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from support.forward_model import seen_through

from sucre_bench.programs.contract.made_scenes import WATER, charted, least, wall
from sucre_bench.programs.contract.side_effects import changed, snapshot


def test_the_least_scene_has_what_is_needed_and_nothing_else() -> None:
    view = least(charted(), frozenset({"depth"}))["far.png"]
    assert view.has_depth
    assert (view.camera, view.cam_from_world, view.reference, view.charts) == (None, None, None, ())


def test_both_views_of_the_wall_see_it_at_the_same_place() -> None:
    from sucre_bench.multiview.pairing import lift, match

    scene = wall()
    assert len(match(lift(scene["far.png"]), scene["near.png"]).pixels) > 500


def test_the_painted_charts_are_read_as_what_they_are() -> None:
    from sucre_bench.imaging.chart_patches import measure

    view = charted()["far.png"]
    for chart in view.charts:
        for reading in measure(np.asarray(view.reference), chart):
            np.testing.assert_allclose(reading.rgb, reading.patch.srgb, atol=1e-6)


def test_the_water_of_the_contract_is_that_of_the_model() -> None:
    """Methods are checked on these scenes: a wrong sign here would let the same wrong sign there pass."""
    view = charted()["far.png"]
    B, beta, gamma = (WATER.veiling_light, WATER.attenuation, WATER.backscatter)
    for y, x, c in itertools.product((0, 20, 60, 95), (0, 30, 70, 127), range(3)):
        expected = seen_through(float(view.reference[y, x, c]), 3.0, B[c], beta[c], gamma[c])
        assert view.rgb[y, x, c] == pytest.approx(expected, abs=1e-6)


def test_changes_of_what_is_global_are_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    before = snapshot()
    assert changed(before, snapshot()) == []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SUCRE_BENCH_TRIED", "1")
    (folder, variable) = changed(before, snapshot())
    assert "directory" in folder
    assert variable == "os.environ[SUCRE_BENCH_TRIED]"
