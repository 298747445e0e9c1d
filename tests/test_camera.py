"""Geometry, against points worked out by hand."""

import numpy as np
import pytest

from sucre_bench import Camera
from sucre_bench.camera import distance_map, pixel_rays, project, relative_pose, unproject

# The point X = (0.1, 0.2, 2) of the world. The first camera sits at the origin: x = 100 * 0.1 / 2 + 50 = 55,
# y = 100 * 0.2 / 2 + 40 = 50. The second is at (2, 0, 2) and looks along -x (its right is +z): in its frame X is
# (0, 0.2, 1.9), so that x = 32, y = 95 * 0.2 / 1.9 + 24 = 34.
X = np.array([0.1, 0.2, 2.0])
FIRST = Camera(np.array([[100.0, 0, 50], [0, 100, 40], [0, 0, 1]]), 100, 80)
SECOND = Camera(np.array([[95.0, 0, 32], [0, 95, 24], [0, 0, 1]]), 64, 48)
FIRST_POSE = np.eye(4)
SECOND_POSE = np.array([[0.0, 0, 1, -2], [0, 1, 0, 0], [-1, 0, 0, 2], [0, 0, 0, 1]])


def test_a_known_point_lands_where_it_must_in_two_views() -> None:
    for camera, pose, expected, depth in ((FIRST, FIRST_POSE, (55, 50), 2), (SECOND, SECOND_POSE, (32, 34), 1.9)):
        xy, z = project(camera, (pose @ np.append(X, 1))[:3])
        np.testing.assert_allclose(xy, expected, atol=1e-9)
        assert z == pytest.approx(depth)


def test_the_relative_pose_takes_the_first_cameras_points_to_the_second() -> None:
    first_pose = np.array([[0.0, -1, 0, 0.3], [1, 0, 0, -0.2], [0, 0, 1, 0.5], [0, 0, 0, 1]])  # a quarter roll, moved
    in_first = np.array([-0.2 + 0.3, 0.1 - 0.2, 2.5, 1])  # X there, by hand
    moved = relative_pose(SECOND_POSE, first_pose) @ in_first
    np.testing.assert_allclose(moved, [0, 0.2, 1.9, 1], atol=1e-12)


def test_unprojecting_a_pixel_with_its_depth_gives_the_point() -> None:
    point = unproject(FIRST, np.array([55.0]), np.array([50.0]), np.array([2.0]))
    np.testing.assert_allclose(point, X[:, None], atol=1e-12)


def test_distance_is_the_hypotenuse_over_planar_depth() -> None:
    # The middle of the only pixel is 0.75 focal lengths off the axis: a 3-4-5 triangle.
    camera = Camera(np.array([[1.0, 0, -0.25], [0, 1, 0.5], [0, 0, 1]]), 1, 1)
    np.testing.assert_allclose(pixel_rays(camera)[0, 0], [0.75, 0, 1])
    np.testing.assert_allclose(distance_map(camera, np.full((1, 1), 4, np.float32)), [[5]])


def test_unknown_depth_is_unknown_distance() -> None:
    depth = np.zeros((FIRST.height, FIRST.width), np.float32)
    assert not distance_map(FIRST, depth).any()


@pytest.mark.parametrize("z", [0.0, -2.0])
def test_points_at_or_behind_the_camera_land_nowhere(z: float) -> None:
    behind = np.array([0.1, 0.2, z])
    assert np.isnan(project(FIRST, behind)[0]).all()
