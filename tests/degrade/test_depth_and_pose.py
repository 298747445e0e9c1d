"""Noise and holes in depth maps, and noise in poses."""

import numpy as np
import pytest
from support.made_scene import many, of, photo

from sucre_bench.degrade import degraded


@pytest.mark.parametrize("grain", [0.0, 3.0])
def test_depth_noise_is_relative_and_as_smooth_as_asked(grain: float):
    """Neighbours of white noise smoothed by a Gaussian of sd s correlate by exp(-1 / (4 s^2))."""
    depth = np.where(np.arange(300) < 150, 2.0, 8.0) * np.ones((200, 1))
    depth[:20] = 0
    view = degraded(of(photo(200, 300), depth), depth_noise=0.05, depth_noise_px=grain)["a.png"]
    assert np.array_equal(view.depth == 0, depth == 0)
    relative = (view.depth.astype(float) / np.where(depth == 0, 1, depth))[20:] - 1
    near, far = relative[:, :150], relative[:, 150:]
    assert (near.std(), far.std()) == (pytest.approx(0.05, rel=0.15), pytest.approx(0.05, rel=0.15))
    correlation = (relative[:, 1:] * relative[:, :-1]).mean() / (relative**2).mean()
    assert correlation == pytest.approx(np.exp(-1 / (4 * grain**2)) if grain else 0, abs=0.02)
    assert np.array_equal(view.rgb, photo(200, 300))


@pytest.mark.parametrize(("grain", "alike"), [(0.0, 0.75), (10.0, 1.0)])
def test_holes_take_the_share_asked_for_of_the_known_pixels(grain: float, alike: float):
    """alike: of a hole's pixels, how many have another to their right: the share itself where each is its own."""
    depth = np.full((200, 300), 3.0)
    depth[:, :100] = 0
    got = degraded(of(photo(200, 300), depth), depth_holes=0.75, depth_hole_px=grain)["a.png"].depth
    lost = (got == 0)[:, 100:]
    assert lost.mean() == pytest.approx(0.75, abs=1e-3)
    assert (got[got > 0] == 3).all()
    assert lost[:, 1:][lost[:, :-1]].mean() == pytest.approx(alike, abs=0.03)


def test_pose_noise_moves_the_centre_and_turns_the_camera_by_what_is_asked():
    from scipy.spatial.transform import Rotation

    scene = many(600)
    moved, turned = degraded(scene, pose_noise_m=0.05), degraded(scene, pose_noise_deg=2.0)
    shifts, turns = [], []
    for view in scene:
        at, before, after = view.cam_from_world, moved[view.name].cam_from_world, turned[view.name].cam_from_world
        shifts.append(np.linalg.inv(before)[:3, 3] - np.linalg.inv(at)[:3, 3])
        np.testing.assert_allclose(before[:3, :3], at[:3, :3], atol=1e-12)
        turns.append(Rotation.from_matrix(after[:3, :3] @ at[:3, :3].T).as_rotvec(degrees=True))
        np.testing.assert_allclose(np.linalg.inv(after)[:3, 3], np.linalg.inv(at)[:3, 3], atol=1e-9)
        np.testing.assert_allclose(after[:3, :3] @ after[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.std(shifts, axis=0) == pytest.approx([0.05] * 3, rel=0.1)
    assert np.std(turns, axis=0) == pytest.approx([2.0] * 3, rel=0.1)
    assert moved["v0.png"].pixels is scene["v0.png"].pixels  # nothing is decoded twice
