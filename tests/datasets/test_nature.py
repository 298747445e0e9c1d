"""Scenes of nature are what they say: formation, truth, and what each condition does, recomputed from outside."""

from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from support.forward_model import in_water
from support.two_views import carried

from sucre_bench.arrays import Array
from sucre_bench.camera import distance_map, moved, project, relative_pose, unproject
from sucre_bench.datasets.nature import Nature
from sucre_bench.datasets.nature.conditions import Name
from sucre_bench.scene import Scene

SMALL: dict[str, Any] = {"width": 64, "height": 48, "views": 4}


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("nature")


@pytest.fixture
def exact(root: Path) -> Nature:
    return Nature(root=root, errors="none", condition="ideal", **SMALL)


def scene_of(nature: Nature) -> Scene:
    (scene,) = nature.scenes()
    return scene


def test_the_photograph_is_the_reference_in_the_stated_water(exact: Nature):
    """I = J exp(-beta z) + B (1 - exp(-gamma z)), up to what the mean over a pixel's rays does at depth edges."""
    scene = scene_of(exact)
    assert scene.water is not None
    for view in scene:
        made = in_water(view.reference, view.distance, scene.water)
        off = np.abs(made - view.rgb)[view.valid]
        assert np.median(off) < 1e-3
        assert np.quantile(off, 0.95) < 0.02
    assert np.ptp(scene[0].distance[scene[0].valid]) > 1


def test_points_of_one_view_lie_where_another_sees_them(exact: Nature):
    """Depth and poses agree: a point's depth from the next camera is what that view's depth map has."""
    first, second = scene_of(exact).views[1:3]
    _, there, z = carried(first, second)
    assert len(z) > 300
    assert np.median(np.abs(second.depth[there] / z - 1)) < 0.02


def test_equal_options_make_equal_scenes_and_a_stored_scene_is_read(root: Path, tmp_path: Path):
    nature = Nature(root=root, condition="all_mild", **SMALL)
    first = nature.arrays()
    again = replace(nature, root=tmp_path).arrays()
    assert all(np.array_equal(first[name], again[name], equal_nan=True) for name in first)
    (file,) = tmp_path.glob("*/rgb.npy")
    time = file.stat().st_mtime_ns
    replace(nature, root=tmp_path).arrays()
    assert file.stat().st_mtime_ns == time
    file.write_bytes(b"damaged")
    assert (replace(nature, root=tmp_path).arrays()["rgb"] == first["rgb"]).all()
    other = replace(nature, seed=1)
    assert other.data_id != nature.data_id
    assert not (other.arrays()["depth"] == first["depth"]).all()


def relative_error(nature: Nature) -> Array:
    """The relative error of depth (V, H, W); the ground and the true poses are those of the exact scene."""
    true = replace(nature, condition="ideal", errors="none").arrays()["depth"]
    given = nature.arrays()["depth"]
    return np.where(true > 0, given / np.maximum(true, 1e-6) - 1, np.nan)


@pytest.mark.parametrize(
    ("condition", "errors", "rms"), [("depth_3", "none", 0.03), ("plain", "mild", 0.005)]
)
def test_depth_is_wrong_in_patches_by_what_is_said(
    exact: Nature, condition: Any, errors: Any, rms: float
):
    error = relative_error(replace(exact, condition=condition, errors=errors))
    assert np.sqrt(np.nanmean(error**2)) == pytest.approx(rms, rel=0.1)
    neighbours = np.nanmean(error[:, :, 1:] * error[:, :, :-1]) / np.nanmean(error**2)
    far = np.nanmean(error[:, :, 24:] * error[:, :, :-24]) / np.nanmean(error**2)
    assert neighbours > 0.9
    assert abs(far) < 0.4


@pytest.mark.parametrize(
    ("condition", "errors", "px"), [("pose_2", "none", 2.0), ("plain", "mild", 0.5)]
)
def test_poses_drift_by_the_pixels_that_are_said(
    exact: Nature, condition: Any, errors: Any, px: float
):
    """A point in the middle of each image, projected by the true and by the given pose."""
    wrong = replace(exact, condition=condition, errors=errors, views=12)
    true, given = replace(exact, views=12).arrays(), scene_of(wrong)
    moves = []
    for pose, depth, view in zip(true["pose"], true["depth"], given, strict=True):
        z = np.median(depth[depth > 0])
        point = unproject(view.camera, 32, 24, z)
        there, _ = project(view.camera, moved(point, relative_pose(view.cam_from_world, pose)))
        moves.append(there - (32, 24))
    move = np.array(moves)
    assert np.sqrt((move**2).sum(axis=1).mean()) == pytest.approx(px, rel=0.1)
    steps = np.diff(move, axis=0)
    assert (steps**2).mean() < (
        move**2
    ).mean()  # a drift, not a jitter: neighbours are off alike


def test_conditions_do_what_they_say(exact: Nature):
    plain = exact.arrays()["rgb"]

    def made(condition: Any, **options: Any) -> Array:
        return replace(exact, condition=condition, **options).arrays()["rgb"]

    assert (made("noise_3") - plain).std() == pytest.approx(0.03, rel=0.1)
    is_fish = (np.abs(made("fish") - plain) > 0.03).any(axis=-1)
    assert (is_fish.mean(axis=(1, 2)) > 0.05).sum() == 1
    # the ground behind fish has no true colour: a picture may show them
    unknown = np.isnan(replace(exact, condition="fish").arrays()["reference"]).any(axis=-1)
    assert (is_fish & unknown).sum() > 0.9 * unknown.sum()
    lens = made("vignette_35")
    corner, middle = np.s_[:, 0, 0], np.s_[:, 23:25, 31:33]
    assert np.median(lens[corner] / plain[corner]) == pytest.approx(0.65, abs=0.05)
    assert np.median(lens[middle] / plain[middle]) == pytest.approx(1, abs=0.02)
    assert made("auto_exposure").mean(axis=(1, 2, 3)) == pytest.approx(
        np.full(4, 0.4), abs=0.02
    )
    balanced, unbalanced = (
        images.mean(axis=(1, 2)) for images in (made("auto_white_balance"), plain)
    )
    assert (np.ptp(balanced, axis=1) < 0.7 * np.ptp(unbalanced, axis=1)).all()
    air = scene_of(replace(exact, condition="air"))
    assert np.abs(air[0].rgb - air[0].reference)[air[0].valid].mean() < 0.01
    assert distance_map(air[0].camera, air[0].depth).max() > 3


# Whether one water holds for all pixels of a condition. Only then a scene tells its water.
WATER_HOLDS = {
    "plain": True,
    "strobe": False,
    "camera": False,
    "exposure_30": False,
    "patchy_water": False,
}


@pytest.mark.parametrize("condition", get_args(Name))
def test_every_condition_loads(root: Path, condition: Any):
    scene = scene_of(Nature(root=root, condition=condition, width=64, height=48, views=2))
    assert len(scene) == 2
    if condition in WATER_HOLDS:
        assert ("truth" in scene.has) is WATER_HOLDS[condition]
        assert (scene.water is not None) is WATER_HOLDS[condition]
    for view in scene:
        assert np.isfinite(view.rgb).all()
        assert np.isfinite(view.reference).mean() > 0.8
        assert (view.depth > 0).mean() > 0.5
