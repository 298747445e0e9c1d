"""Added water and noise of depth and pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.forward_model import in_water
from support.made_scene import NINE, many, of, photo

from sucre_bench import Camera, InputError, Water
from sucre_bench.degrade import Degradation, degraded

# -- water -----------------------------------------------------------------------------------------------


def test_added_water_follows_the_model_at_the_distance_from_the_camera():
    """A corner pixel 2 m deep, seen at an angle: z = 2 sqrt(1 + x^2 + y^2), by hand."""
    camera = Camera(np.array([[40.0, 0, 40], [0, 40, 30], [0, 0, 1]]), 80, 60)
    made = degraded(of(photo(), np.full((60, 80), 2.0), camera=camera), add_water=NINE)
    view = made["a.png"]
    z = 2 * np.sqrt(1 + (39.5 / 40) ** 2 + (29.5 / 40) ** 2)
    water = Water(*np.reshape(NINE, (3, 3)))
    np.testing.assert_allclose(
        view.rgb[:1, 0], in_water(photo()[:1, 0], np.array([z]), water), atol=1e-6
    )
    assert np.array_equal(view.reference, photo())
    assert made.has == {"depth", "poses", "reference", "truth"}
    assert np.array_equal(made.water.attenuation, water.attenuation)


def test_water_goes_over_the_reference_where_the_scene_has_some():
    depth = np.full((60, 80), 2.0)
    dry = degraded(of(photo(), depth), add_water=NINE)["a.png"]
    wet = degraded(of(photo() * 0.2, depth, photo()), add_water=NINE)["a.png"]
    assert np.array_equal(wet.rgb, dry.rgb)
    lacking = replace(of(photo(), depth), has=frozenset({"depth", "reference"}))
    with pytest.raises(InputError, match=r"a\.png: .*reference"):
        _ = degraded(lacking, add_water=NINE)["a.png"].rgb


def test_a_pixel_without_depth_is_as_deep_under_water_as_its_nearest_neighbour():
    depth = np.full((60, 80), 2.0)
    depth[:, 40:] = 6
    holes = depth.copy()
    holes[10:20, 10:20] = holes[10:20, 60:70] = 0
    whole, pierced = (degraded(of(photo(), d), add_water=NINE)["a.png"] for d in (depth, holes))
    assert np.array_equal(whole.rgb, pierced.rgb)
    assert not pierced.valid[15, 15]
    with pytest.raises(InputError, match=r"a\.png: .*depth"):
        _ = degraded(of(photo(), np.zeros((60, 80))), add_water=NINE)["a.png"].rgb


def test_water_is_given_as_numbers_or_itself():
    B, beta, gamma = np.reshape(NINE, (3, 3))
    given = [
        Degradation(add_water=w) for w in (list(NINE), Water(B, beta, gamma), np.array(NINE))
    ]
    assert len({d.data_id("x") for d in given}) == 1
    assert given[0].labelled("air") == "air,add_water=0.1_0.2_0.3_0.4_0.2_0.1_0.3_0.2_0.15"


def test_water_is_added_to_intensities_that_it_explains():
    parts = np.reshape(NINE, (3, 3))
    assert degraded(many(), add_water=Water(*parts, "gamma"))[0].rgb.any()
    with pytest.raises(InputError, match=r"linear.*gamma"):
        _ = degraded(many(), add_water=Water(*parts, "linear"))[0].rgb


# -- labels, hashes, runs --------------------------------------------------------------------------------


@pytest.mark.parametrize("grain", [0.0, 3.0])
def test_depth_noise_is_relative_and_as_smooth_as_asked(grain: float):
    """Neighbours of white noise smoothed by a Gaussian of sd s correlate by exp(-1 / (4 s^2))."""
    depth = np.where(np.arange(300) < 150, 2.0, 8.0) * np.ones((200, 1))
    depth[:20] = 0
    view = degraded(of(photo(200, 300), depth), depth_noise=0.05, depth_noise_px=grain)["a.png"]
    assert np.array_equal(view.depth == 0, depth == 0)
    relative = (view.depth.astype(float) / np.where(depth == 0, 1, depth))[20:] - 1
    near, far = relative[:, :150], relative[:, 150:]
    assert [near.std(), far.std()] == pytest.approx([0.05, 0.05], rel=0.15)
    correlation = (relative[:, 1:] * relative[:, :-1]).mean() / (relative**2).mean()
    assert correlation == pytest.approx(np.exp(-1 / (4 * grain**2)) if grain else 0, abs=0.02)
    assert np.array_equal(view.rgb, photo(200, 300))


@pytest.mark.parametrize(("grain", "alike"), [(0.0, 0.75), (10.0, 1.0)])
def test_holes_take_the_share_asked_for_of_the_known_pixels(grain: float, alike: float):
    """alike: of a hole's pixels, how many have another to their right: the share itself where each is its own."""
    depth = np.full((200, 300), 3.0)
    depth[:, :100] = 0
    got = degraded(of(photo(200, 300), depth), depth_holes=0.75, depth_hole_px=grain)[
        "a.png"
    ].depth
    lost = (got == 0)[:, 100:]
    assert lost.mean() == pytest.approx(0.75, abs=1e-3)
    assert (got[got > 0] == 3).all()
    assert lost[:, 1:][lost[:, :-1]].mean() == pytest.approx(alike, abs=0.03)


def test_pose_noise_moves_the_centre_and_turns_the_camera_by_what_is_asked():
    from scipy.spatial.transform import Rotation

    scene = many(600)
    moved, turned = degraded(scene, pose_noise_m=0.05), degraded(scene, pose_noise_deg=2.0)
    at, before, after = (
        np.stack([view.cam_from_world for view in one]) for one in (scene, moved, turned)
    )
    centres, centres_before, centres_after = (
        np.linalg.inv(poses)[:, :3, 3] for poses in (at, before, after)
    )
    np.testing.assert_allclose(before[:, :3, :3], at[:, :3, :3], atol=1e-12)
    np.testing.assert_allclose(centres_after, centres, atol=1e-9)
    rotations = after[:, :3, :3]
    np.testing.assert_allclose(np.linalg.inv(rotations), rotations.swapaxes(1, 2), atol=1e-12)
    shifts = centres_before - centres
    turns = Rotation.from_matrix(rotations @ at[:, :3, :3].swapaxes(1, 2)).as_rotvec(
        degrees=True
    )
    assert np.std(shifts, axis=0) == pytest.approx([0.05] * 3, rel=0.1)
    assert np.std(turns, axis=0) == pytest.approx([2.0] * 3, rel=0.1)
    assert moved["v0.png"].pixels is scene["v0.png"].pixels  # nothing is decoded twice
