"""Images under water, by transmission and by distance."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.forward_model import CLEAR, alone, random_seabed, view_in_water
from support.made_scene import WATER, make_camera, make_pose, make_view

import sucre_bench as sb
from sucre_bench import Arrays, Restoration, View, Water
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.imaging.image_formation import (
    brightest,
    reduced,
    restoration,
    undetermined,
)

RNG = np.random.default_rng(0)
A = np.array([0.2, 0.5, 0.6])


def test_the_brightest_pixel_is_a_pixel_of_the_image_and_of_those_asked_for() -> None:
    """Public ports take the row of the pixel for a channel: here that would give no colour of the image at all."""
    image = np.full((5, 6, 3), 0.1, np.float32)
    image[0, 5] = 1, 1, 1
    image[4, 2] = 0.3, 0.9, 0.2
    image[3, 1] = 0.8, 0.1, 0.1
    among = np.ones((5, 6), bool)
    among[0, 5] = False
    np.testing.assert_array_equal(brightest(image, among), image[4, 2])


def test_a_restoration_tells_the_veiling_light() -> None:
    t = np.array([[[0.2, 0.4, 0.6], [0.4, 0.8, 0.6]]])
    result = restoration(np.full((1, 2, 3), 0.3, np.float32), A, t, extra=1)
    np.testing.assert_array_equal(result.water.veiling_light, A)
    assert np.isnan(result.water.attenuation).all()
    assert np.isnan(result.water.backscatter).all()
    assert result.info["extra"] == 1


def test_reducing_averages_and_leaves_small_images_alone() -> None:
    image = RNG.random((60, 90, 3), dtype=np.float32)
    assert reduced(image, 90) is image
    expected = image.reshape(20, 3, 30, 3, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(reduced(image, 30), expected, atol=1e-6)
    assert reduced(image[:1], 2).shape == (1, 2, 3)


each = pytest.mark.parametrize("method", ["seathru", "gaussian_seathru"])


def restore(method: str, view: View, **options: Any) -> Restoration:
    return sb.restore(method, alone(view), view, **options)


def water_of(result: Restoration) -> Water:
    assert result.water is not None
    return result.water


def veil(water: Water) -> np.ndarray:
    """B and gamma change places more than what they make together, from 2 to 8 m."""
    return np.asarray(
        water.veiling_light * (1 - np.exp(-np.outer(np.linspace(2, 8, 20), water.backscatter)))
    )


def normal_seabed(seed: int = 0) -> View:
    """Colours drawn from N(0.5, 0.1), in the water CLEAR."""
    z = np.tile(np.linspace(2, 8, 160, dtype=np.float32)[:, None], (1, 120))
    return view_in_water(np.random.default_rng(seed).normal(0.5, 0.1, (160, 120, 3)), z, CLEAR)


# -- distances -------------------------------------------------------------------------------------------------


def test_distances_are_flat_within_a_fiftieth_and_doubts_name_their_channels():
    doubts = {"veil": np.array([True, False, True]), "light": np.zeros(3, dtype=bool)}
    assert undetermined(np.array([5.0, 5.09]), "anything", doubts).endswith(
        "equally far: anything"
    )
    assert undetermined(np.array([5.0, 5.11]), "anything", doubts) == "veil of red, blue"


@each
def test_pixels_without_depth_have_no_colour_and_no_influence(method: str):
    view = random_seabed(5)
    depth, rgb = view.depth.copy(), view.rgb.copy()
    depth[40:90, 30:60] = 0
    results = []
    for colour in (0.0, 1.0):
        rgb[40:90, 30:60] = colour
        results.append(restore(method, replace(view, pixels=Arrays(rgb, depth))).image)
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(np.isnan(results[0]).all(axis=-1), depth == 0)


@each
def test_euclidean_distance_is_used_where_the_camera_is_known(method: str):
    view = make_view("a.png", make_camera(60, 44, 30), make_pose((0, 0, 0)), WATER)
    far = replace(view, pixels=Arrays(view.rgb, view.distance), camera=None)
    expected, found = (restore(method, v) for v in (far, view))
    assert (expected.info["along"], found.info["along"]) == ("depth", "distance")
    np.testing.assert_array_equal(found.image, expected.image)


@each
def test_a_single_distance_is_said_to_tell_nothing(method: str):
    view = View(
        "wall.png", Arrays(np.random.default_rng(0).random((20, 30, 3)), np.full((20, 30), 3.0))
    )
    result = restore(method, view)
    assert "equally far" in result.info["undetermined"]
    assert np.isfinite(result.image).all()
    assert np.abs(result.image).max() < 5


@each
@pytest.mark.parametrize("astray_m", [15.0, 300.0])
def test_distances_gone_astray_hardly_move_the_water(method: str, astray_m: float):
    """Sixty of 19,200, which lie at two to eight metres."""
    view = random_seabed(8) if method == "seathru" else normal_seabed(8)
    depth = view.depth.copy()
    depth.ravel()[np.random.default_rng(0).permutation(depth.size)[:60]] = astray_m
    options = {"attenuation": "two_term"} if method == "seathru" else {}
    clean, astray = (
        restore(method, v, **options)
        for v in (view, replace(view, pixels=Arrays(view.rgb, depth)))
    )
    np.testing.assert_allclose(veil(water_of(astray)), veil(water_of(clean)), atol=0.015)
    np.testing.assert_allclose(
        water_of(astray).attenuation, water_of(clean).attenuation, rtol=0.04
    )
    same = depth < 9
    assert np.abs(astray.image - clean.image)[same].mean() < 0.01
    assert np.isfinite(astray.image).all()


# -- what the water that they report explains ------------------------------------------------------------------


@each
def test_a_water_of_encoded_intensities_says_so_also_on_linear_views(method: str):
    """Intensities of a linear view follow the model once they are encoded."""
    view = random_seabed(9) if method == "seathru" else normal_seabed(9)
    stored = replace(view, pixels=Arrays(srgb_decode(view.rgb), view.depth), encoding="linear")
    water = water_of(restore(method, stored))
    assert water.encoding == "gamma"
    np.testing.assert_allclose(veil(water), veil(CLEAR), atol=0.03)
    np.testing.assert_allclose(water.attenuation, CLEAR.attenuation, rtol=0.1, atol=0.01)


@pytest.mark.parametrize("encoding", ["gamma", "linear"])
def test_a_water_of_linear_light_says_so_also_on_encoded_views(encoding: str):
    view = replace(random_seabed(9), encoding="linear")
    if encoding == "gamma":
        view = replace(view, pixels=Arrays(srgb_encode(view.rgb), view.depth), encoding="gamma")
    water = water_of(restore("seathru", view, raw=True))
    assert water.encoding == "linear"
    np.testing.assert_allclose(veil(water), veil(CLEAR), atol=0.03)
