"""saturated_red, coverage and negative: against the HSV of scikit-image, and pictures counted by hand."""

from __future__ import annotations

import numpy as np
import pytest
from skimage.color import rgb2hsv

from sucre_bench.arrays import Array
from sucre_bench.metrics.shares_and_counts import Coverage, Negative, SaturatedRed
from sucre_bench.scene import Arrays, Chart, Restoration, Score, View


def score(shown: Array, *charts: Chart) -> Score:
    view = View("a.png", Arrays(shown), charts=charts)
    (found,) = SaturatedRed().score(Restoration(shown), shown, view, "hsv")
    return found


def test_random_colours_are_red_where_scikit_images_hsv_says_so() -> None:
    shown = np.random.default_rng(0).random((200, 300, 3)).astype(np.float32)
    shown[0] = 0
    hue, saturation, value = np.moveaxis(rgb2hsv(shown.astype(np.float64)), -1, 0)
    red = (np.minimum(hue, 1 - hue) * 360 <= 25) & (saturation > 0.5) & (value > 0.1)
    assert red.mean() > 0.05
    assert score(shown).value == pytest.approx(red.mean(), abs=1e-9)


def test_charts_and_holes_do_not_count() -> None:
    shown = np.full((50, 100, 3), 0.5, np.float32)
    shown[10:30, 20:60] = (1, 0, 0)  # the chart
    shown[40:, :] = np.nan
    shown[0, :50] = (1, 0, 0)
    chart = Chart("c", "dgk", np.array([[20.0, 10], [60, 10], [60, 30], [20, 30]]))
    found = score(shown, chart)
    assert found.n_pixels == 40 * 100 - 20 * 40
    assert found.value == pytest.approx(50 / found.n_pixels)
    assert found.coverage == pytest.approx(found.n_pixels / 5000)


NAN = np.nan
IMAGE = np.array(
    [[[0.1, 0.2, 0.3], [-0.1, 0.2, -0.3]], [[NAN, 0.2, 0.3], [1.5, -0.2, 0.0]]], np.float32
)


def counted(
    metric: Coverage | Negative, variant: str, depth: Array | None = None
) -> list[Score]:
    view = View("a.png", Arrays(np.zeros_like(IMAGE), depth))
    return list(metric.score(Restoration(IMAGE), IMAGE, view, variant))


def test_coverage_is_the_share_of_pixels_with_all_three_channels() -> None:
    assert counted(Coverage(), "image") == [Score(0.75, "image", 4, 1.0)]


def test_coverage_of_depth_asks_only_for_pixels_with_depth() -> None:
    depth = np.array([[0, 1], [2, 0]], np.float32)
    assert counted(Coverage(), "depth", depth=depth) == [Score(0.5, "image", 2, 0.5)]
    assert counted(Coverage(), "depth") == []


@pytest.mark.parametrize(
    ("variant", "count"), [("any", 2), ("red", 1), ("green", 1), ("blue", 1)]
)
def test_negative_is_the_share_of_coloured_pixels_below_0(variant: str, count: int) -> None:
    assert counted(Negative(), variant) == [Score(count / 3, "image", 3, 0.75)]


def test_negative_reads_the_computed_image_not_the_shown_one() -> None:
    view = View("a.png", Arrays(np.zeros_like(IMAGE)))
    (found,) = Negative().score(Restoration(IMAGE), IMAGE.clip(0, 1), view, "any")
    assert found.value == 2 / 3
