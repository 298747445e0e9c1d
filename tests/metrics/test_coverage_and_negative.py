"""coverage and negative, on images counted by hand."""

import numpy as np
import pytest

from sucre_bench.arrays import Array
from sucre_bench.metrics.shares_and_counts import Coverage, Negative
from sucre_bench.scene import Arrays, Restoration, Score, View

NAN = np.nan
IMAGE = np.array([[[0.1, 0.2, 0.3], [-0.1, 0.2, -0.3]], [[NAN, 0.2, 0.3], [1.5, -0.2, 0.0]]], np.float32)


def score(metric: Coverage | Negative, variant: str, image: Array = IMAGE, depth: Array | None = None) -> list[Score]:
    view = View("a.png", Arrays(np.zeros_like(image), depth))
    return list(metric.score(Restoration(image), image, view, variant))


def test_coverage_is_the_share_of_pixels_with_all_three_channels() -> None:
    assert score(Coverage(), "image") == [Score(0.75, "image", 4, 1.0)]


def test_coverage_of_depth_asks_only_for_pixels_with_depth() -> None:
    depth = np.array([[0, 1], [2, 0]], np.float32)
    assert score(Coverage(), "depth", depth=depth) == [Score(0.5, "image", 2, 0.5)]
    assert score(Coverage(), "depth") == []


def test_a_depth_map_without_depth_has_no_coverage() -> None:
    (found,) = score(Coverage(), "depth", depth=np.zeros((2, 2), np.float32))
    assert np.isnan(found.value)
    assert found.coverage == 0


@pytest.mark.parametrize(("variant", "count"), [("any", 2), ("red", 1), ("green", 1), ("blue", 1)])
def test_negative_is_the_share_of_coloured_pixels_below_0(variant: str, count: int) -> None:
    assert score(Negative(), variant) == [Score(count / 3, "image", 3, 0.75)]


def test_negative_of_nothing_is_nan() -> None:
    (found,) = score(Negative(), "any", np.full_like(IMAGE, NAN))
    assert np.isnan(found.value)
    assert (found.n_pixels, found.coverage) == (0, 0)


def test_negative_reads_the_computed_image_not_the_shown_one() -> None:
    view = View("a.png", Arrays(np.zeros_like(IMAGE)))
    (found,) = Negative().score(Restoration(IMAGE), IMAGE.clip(0, 1), view, "any")
    assert found.value == 2 / 3
