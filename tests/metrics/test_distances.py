"""chart_distance and distance_variance: charts and surfaces where geometry says how far they are."""

import numpy as np
import pytest

from sucre_bench.arrays import Array
from sucre_bench.camera import Camera
from sucre_bench.errors import NotApplicableError
from sucre_bench.metrics.distances import ChartDistance, DistanceVariance
from sucre_bench.scene import Arrays, Chart, Restoration, Score, View

CAMERA = Camera(np.array([[300.0, 0, 161.3], [0, 310, 118.9], [0, 0, 1]]), 320, 240)
MIDDLE = np.array([1.1, 0.6, 4.0])  # of the chart, in the camera's frame, metres


def corners() -> Array:
    """A square of 20 cm about MIDDLE, tilted about the vertical so that its left is 10 cm nearer than its right."""
    half = np.array(
        [[-0.1, -0.1, -0.05], [0.1, -0.1, 0.05], [0.1, 0.1, 0.05], [-0.1, 0.1, -0.05]]
    )
    points = (MIDDLE + half) @ CAMERA.K.T
    return np.asarray(points[:, :2] / points[:, 2:])


def radius_to_depth(radius: float) -> Array:
    """Planar depth (H, W) of a sphere about the camera's centre."""
    u, v = np.meshgrid(np.arange(320) + 0.5, np.arange(240) + 0.5)
    x, y = (u - 161.3) / 300, (v - 118.9) / 310
    return np.asarray(radius / np.sqrt(x**2 + y**2 + 1), dtype=np.float32)


def plane_depth() -> Array:
    """Planar depth (H, W) of the chart's plane: n . X = n . MIDDLE, with n = (0.5, 0, -1)."""
    u, _ = np.meshgrid(np.arange(320) + 0.5, np.arange(240) + 0.5)
    n = np.array([0.5, 0, -1])
    return np.asarray((n @ MIDDLE) / ((u - 161.3) / 300 * n[0] + n[2]), dtype=np.float32)


def chart_score(depth: Array, at: Array | None = None) -> Score:
    shown = np.zeros((240, 320, 3), np.float32)
    chart = Chart("c", "dgk", corners() if at is None else at)
    view = View("a.png", Arrays(shown, depth), CAMERA, charts=[chart])
    (score,) = ChartDistance().score(Restoration(shown), shown, view, "median")
    assert score.region == "c"
    return score


def test_a_charts_distance_is_that_of_its_middle_from_the_cameras_centre() -> None:
    found = chart_score(plane_depth())
    x, y = corners().T
    area = 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    # its depth, 4 m, is .2 m less
    assert found.value == pytest.approx(np.linalg.norm(MIDDLE), abs=0.01)
    assert found.coverage == 1
    assert found.n_pixels == pytest.approx(area, rel=0.1)


def test_only_the_charts_own_pixels_with_depth_count() -> None:
    depth, at = np.full((240, 320), 9, np.float32), corners()
    left, right = int(at[:, 0].min()), int(np.ceil(at[:, 0].max()))
    top, bottom = int(at[:, 1].min()), int(np.ceil(at[:, 1].max()))
    depth[top:bottom, left:right] = radius_to_depth(5)[top:bottom, left:right]
    depth[top : (top + bottom) // 2, left:right] = 0
    found = chart_score(depth)
    assert found.value == pytest.approx(5, abs=1e-5)
    assert found.coverage == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("at", [None, corners() + 500], ids=["no depth", "outside"])
def test_a_chart_without_depth_is_nan_with_coverage_0(at: Array | None) -> None:
    depth = np.zeros((240, 320), np.float32) if at is None else plane_depth()
    found = chart_score(depth, at=at)
    assert np.isnan(found.value)
    assert (found.n_pixels, found.coverage) == (0, 0)


def test_without_a_camera_there_is_no_distance_and_the_view_is_named() -> None:
    shown = np.zeros((240, 320, 3), np.float32)
    view = View("a.png", Arrays(shown, plane_depth()), charts=[Chart("c", "dgk", corners())])
    for metric in (ChartDistance(), DistanceVariance()):
        with pytest.raises(NotApplicableError, match=r"a\.png: no camera"):
            list(metric.score(Restoration(shown), shown, view, metric.__plugin__.default[0]))
