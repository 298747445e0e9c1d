"""What restorers by veiling light and transmission share, against values computed by hand."""

from __future__ import annotations

import numpy as np
import pytest
from support.made_haze import hazy

from sucre_bench.imaging.image_formation import brightest, highest, nearest_depth, recovered, reduced, restoration

RNG = np.random.default_rng(0)
A = np.array([0.2, 0.5, 0.6])


def test_the_highest_share_is_that_many_pixels_and_at_least_one() -> None:
    plane = RNG.permutation(1000.0 * np.arange(1000)).reshape(25, 40)
    assert sorted(plane[highest(plane, 0.003)]) == [997000, 998000, 999000]
    assert plane[highest(plane, 1e-9)] == [999000]


def test_of_equal_pixels_at_the_limit_all_are_among_the_highest() -> None:
    assert highest(np.full((3, 4), 0.5), 0.1).all()


def test_the_brightest_pixel_is_a_pixel_of_the_image_and_of_those_asked_for() -> None:
    """Public ports take the row of the pixel for a channel: here that would give no colour of the image at all."""
    image = np.full((5, 6, 3), 0.1, np.float32)
    image[0, 5] = 1, 1, 1
    image[4, 2] = 0.3, 0.9, 0.2
    image[3, 1] = 0.8, 0.1, 0.1
    among = np.ones((5, 6), bool)
    among[0, 5] = False
    np.testing.assert_array_equal(brightest(image, among), image[4, 2])


def test_the_nearest_depth_is_the_formula_of_its_paper() -> None:
    image = np.tile(A, (4, 5, 1))
    assert nearest_depth(image, A) == pytest.approx(1)
    image[1, 2, 0] = 0.9  # |.2 - .9| of at most .8
    assert nearest_depth(image, A) == pytest.approx(1 - 0.7 / 0.8)


@pytest.mark.parametrize(("value", "expected"), [(0.0, 1 - 0.6 / 0.6), (1.0, 1 - 0.4 / 0.6)])
def test_a_darker_pixel_counts_as_a_brighter_one_does(value: float, expected: float) -> None:
    """In unsigned integers, the difference of one of the two would wrap around."""
    image = np.tile(A, (4, 5, 1))
    image[3, 3, 2] = value
    assert nearest_depth(image, A) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("channels", [1, 3])
def test_recovery_inverts_the_model(channels: int) -> None:
    J, t = RNG.random((9, 8, 3)), RNG.uniform(0.2, 0.9, (9, 8, channels))
    t = t[..., 0] if channels == 1 else t
    back = recovered(hazy(J, A, t).astype(np.float32), A, t.astype(np.float32))
    np.testing.assert_allclose(back, J, atol=2e-6)
    assert back.dtype == np.float32


def test_a_restoration_tells_the_veiling_light_and_how_much_came_through() -> None:
    t = np.array([[[0.2, 0.4, 0.6], [0.4, 0.8, 0.6]]])
    result = restoration(np.full((1, 2, 3), 0.3, np.float32), A, t, extra=1)
    assert result.water is not None
    np.testing.assert_array_equal(result.water.veiling_light, A)
    assert np.isnan(result.water.attenuation).all()
    assert np.isnan(result.water.backscatter).all()
    assert result.info["transmission_min"] == [0.2, 0.4, 0.6]
    assert result.info["transmission_mean"] == pytest.approx([0.3, 0.6, 0.6])
    assert result.info["transmission_max"] == [0.4, 0.8, 0.6]
    assert result.info["extra"] == 1


def test_reducing_averages_and_leaves_small_images_alone() -> None:
    image = RNG.random((60, 90, 3), dtype=np.float32)
    assert reduced(image, 90) is image
    expected = image.reshape(20, 3, 30, 3, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(reduced(image, 30), expected, atol=1e-6)
    assert reduced(image[:1], 2).shape == (1, 2, 3)
