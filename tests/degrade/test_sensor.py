"""What the sensor does to an image, and a smaller image."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from support.made_scene import of, photo

from sucre_bench import Camera, Chart
from sucre_bench.camera import project
from sucre_bench.degrade import degraded
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.scene import Encoding

# -- the sensor ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("encoding", ["gamma", "linear"])
def test_noise_has_the_standard_deviation_asked_for_in_stored_intensities(encoding: Encoding):
    view = degraded(of(np.full((200, 300, 3), 0.5), encoding=encoding), noise=0.02)["a.png"]
    error = view.rgb.astype(float) - 0.5
    assert error.std(axis=(0, 1)) == pytest.approx([0.02] * 3, rel=0.02)
    assert abs(error.mean()) < 4 * 0.02 / np.sqrt(error.size)
    assert abs(np.corrcoef(error[..., 0].ravel(), error[..., 1].ravel())[0, 1]) < 0.02
    assert abs(np.corrcoef(error[:, 1:].ravel(), error[:, :-1].ravel())[0, 1]) < 0.02


def test_bits_leave_that_many_levels_from_black_to_white():
    ramp = np.linspace(0, 1, 3000, dtype=np.float32).reshape(10, 100, 3)
    rgb = degraded(of(ramp), bits=3)["a.png"].rgb
    np.testing.assert_allclose(np.unique(rgb), np.arange(8) / 7, atol=1e-6)
    assert np.abs(rgb - ramp).max() <= 0.5 / 7 + 1e-6
    noisy = degraded(of(ramp), bits=1, noise=0.3)["a.png"].rgb  # noise comes before the bits
    assert set(np.unique(noisy)) == {0, 1}


def test_jpeg_is_what_a_jpeg_file_gives_back():
    stored = np.rint(photo() * 255).astype(np.uint8)
    _, file = cv2.imencode(".jpg", stored[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 30])
    expected = cv2.imdecode(file, cv2.IMREAD_COLOR)[..., ::-1] / 255
    np.testing.assert_allclose(
        degraded(of(photo()), jpeg_quality=30)["a.png"].rgb, expected, atol=1e-6
    )
    # the file holds the picture as it is shown
    linear = of(srgb_decode(photo()), encoding="linear")
    view = degraded(linear, jpeg_quality=30)["a.png"]
    assert view.encoding == "linear"
    np.testing.assert_allclose(srgb_encode(view.rgb), expected, atol=1e-5)


@pytest.mark.parametrize("encoding", ["gamma", "linear"])
def test_blur_spreads_light_by_its_standard_deviation_and_loses_none(encoding: Encoding):
    image = np.zeros((61, 61, 3), dtype=np.float32)
    image[30, 30] = 0.6  # 0.319 in linear light, by sRGB's formula
    rgb = degraded(of(image, encoding=encoding), blur_px=2.0)["a.png"].rgb.astype(float)
    light = (rgb if encoding == "linear" else srgb_decode(rgb))[..., 1]
    total = 0.6 if encoding == "linear" else ((0.6 + 0.055) / 1.055) ** 2.4
    assert light.sum() == pytest.approx(total, abs=1e-3)
    light = light / light.sum()
    offsets = np.arange(61) - 30.0
    assert light.sum(axis=0) @ offsets == pytest.approx(0, abs=1e-3)
    assert np.sqrt(light.sum(axis=0) @ offsets**2) == pytest.approx(2, rel=0.02)


def test_the_sensor_alters_neither_reference_nor_depth():
    scene = of(photo(), np.full((60, 80), 2.0), photo()[::-1])
    view = degraded(scene, blur_px=1, noise=0.1, bits=4, jpeg_quality=20)["a.png"]
    assert np.array_equal(view.reference, photo()[::-1])
    assert np.array_equal(view.depth, np.full((60, 80), 2.0))
    assert not np.array_equal(view.rgb, photo())


# -- size ------------------------------------------------------------------------------------------------


def test_a_point_still_falls_on_its_pixels_in_a_smaller_image():
    """A block of 3 x 3 pixels of one colour, with its own depth: in every plane it lies where its point projects."""
    camera = Camera(np.array([[70.0, 0, 31.5], [0, 80, 22.5], [0, 0, 1]]), 90, 60)
    rgb, depth = np.zeros((60, 90, 3)), np.full((60, 90), 9.0)
    rgb[36:39, 66:69], depth[36:39, 66:69] = 1, 5
    point = np.array([(67.5 - 31.5) / 70 * 5, (37.5 - 22.5) / 80 * 5, 5])
    scene = of(rgb, depth, rgb, camera=camera)
    chart = Chart("c", "dgk", np.array([[66.0, 36], [69, 36], [69, 39], [66, 39]]))
    scene = replace(scene, views=[replace(scene.views[0], charts=[chart])])
    view = degraded(scene, scale=1 / 3)["a.png"]
    assert (view.camera.width, view.camera.height, view.rgb.shape) == (30, 20, (20, 30, 3))
    assert project(view.camera, point)[0] == pytest.approx([22.5, 12.5])
    for plane in (view.rgb[..., 0], view.reference[..., 0], view.depth == 5):
        assert np.argwhere(plane).tolist() == [[12, 22]]
    np.testing.assert_allclose(view.charts[0].corners, [[22, 12], [23, 12], [23, 13], [22, 13]])
    # nothing in between
    assert set(np.unique(degraded(scene, scale=0.4)["a.png"].depth)) == {
        5,
        9,
    }
    without_camera = replace(scene, views=[replace(scene.views[0], camera=None)])
    corners = degraded(without_camera, scale=1 / 3)["a.png"].charts[0].corners
    np.testing.assert_allclose(corners, view.charts[0].corners)
