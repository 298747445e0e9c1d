"""Pixels without a colour, and the way back through a lens."""

import cv2
import numpy as np

from sucre_bench.camera import Camera
from sucre_bench.loading.lens import Lens
from sucre_bench.programs.restore.whole import as_photographed, whole, with_open_water


def test_holes_show_the_photograph_in_the_colours_at_the_rim() -> None:
    y, x = np.mgrid[:90, :120] / 120
    photograph = np.stack([0.2 + 0.1 * x, 0.4 + 0.1 * y, 0.5 + 0.1 * np.sin(9 * x)], axis=-1).astype(np.float32)
    restored = photograph + np.array([0.2, -0.1, -0.2], np.float32)
    known = np.ones((90, 120), bool)
    known[30:60, 50:] = False
    made = whole(np.where(known[..., None], restored, 0), known, photograph)
    assert (made[known] == restored[known]).all()
    np.testing.assert_allclose(made, restored, atol=0.002)  # no step at the rim, and the photograph's detail


def test_without_any_colour_the_photograph_is_left() -> None:
    photograph = np.full((8, 9, 3), 0.3, np.float32)
    assert (whole(np.zeros_like(photograph), np.zeros((8, 9), bool), photograph) == photograph).all()


def test_open_water_stays_as_photographed_and_holes_in_the_ground_do_not() -> None:
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:300, :400]
    ground = (y > 120)[..., None]
    photograph = np.where(ground, [0.3, 0.4, 0.4] + 0.1 * rng.standard_normal((300, 400, 1)), [0.1, 0.5, 0.6])
    photograph = cv2.GaussianBlur(photograph.astype(np.float32), (0, 0), 1.5).clip(0, 1)
    measured = ground[..., 0] & ((x - 200) ** 2 + (y - 220) ** 2 > 30**2)
    picture = photograph + np.array([0.3, -0.1, -0.2], np.float32)
    false = (x - 200) ** 2 + (y - 40) ** 2 < 8**2  # 50 cells of depth that stands in the water
    made = with_open_water(picture, measured | false, photograph)
    assert (made[measured] == picture[measured]).mean() > 0.98  # a cell of the rim may be mostly water
    np.testing.assert_allclose(made[:80], photograph[:80], atol=0.02)
    np.testing.assert_allclose(made[140:], picture[140:], atol=0.02)


def test_a_picture_comes_back_as_the_camera_saw_it() -> None:
    lens = Lens(Camera(np.array([[200.0, 0, 118], [0, 205, 92], [0, 0, 1]]), 240, 180), "perspective", (-0.15,))
    noise = np.random.default_rng(0).random((12, 16, 3)).astype(np.float32)
    photograph = cv2.resize(noise, (240, 180), interpolation=cv2.INTER_CUBIC).clip(0, 1)
    straight = lens.resampled(photograph, lens.pinhole)
    assert np.abs(straight - photograph).mean() > 0.02  # the lens distorts
    back, shown = as_photographed(lens, straight, np.ones((180, 240), bool))
    assert 0.5 < shown.mean() < 1  # a pinhole image looks at less
    assert np.abs(back - photograph)[shown].max() < 0.03
    assert np.abs(back - photograph)[shown].mean() < 0.002
