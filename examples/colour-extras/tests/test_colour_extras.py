from __future__ import annotations

import numpy as np
import pytest
from sucre_bench import Arrays, Restoration, Scene, View, load_scenes
from sucre_bench.programs.contract import breaches

from colour_extras.colourfulness import Colourfulness
from colour_extras.white_patch import WhitePatch


def test_the_brightest_of_each_channel_becomes_white() -> None:
    rgb = np.array([[[0.1, 0.2, 0.0], [0.2, 0.8, 0.0]]], np.float32)
    view = View("a.png", Arrays(rgb))
    image = WhitePatch(percentile=100).restore(Scene("one", [view], frozenset()), view).image
    np.testing.assert_allclose(image, [[[0.5, 0.25, 0], [1, 1, 0]]])


def test_colourfulness_is_that_of_the_formula() -> None:
    """Half red, half gray: rg is 255 or 0, yb 127.5 or 0; each as far from its mean as its mean from 0."""
    shown = np.array([[[1, 0, 0], [0.5, 0.5, 0.5]]])
    (score,) = Colourfulness().score(Restoration(shown), shown, View("a.png", Arrays(shown)), "255")
    assert score.value == pytest.approx(1.3 * np.hypot(127.5, 63.75))


def test_the_nearest_view_of_the_ramp_shows_most_of_its_colours() -> None:
    scene = next(load_scenes("ramp"))
    off = [float(np.abs(view.rgb - view.reference).mean()) for view in scene]
    assert off == sorted(off, reverse=True)


@pytest.mark.parametrize(
    ("kind", "name"), [("method", "white_patch"), ("metric", "colourfulness"), ("dataset", "ramp")]
)
def test_each_keeps_the_contract(kind: str, name: str) -> None:
    assert not breaches(kind, name)
