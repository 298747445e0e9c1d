"""Red compensation, against its three steps in float64."""

import numpy as np
import pytest
from support.forward_model import restored_image as restored

from sucre_bench.methods.red_compensation import RedCompensation

RNG = np.random.default_rng(0)
WATER = np.float32([0.1, 0.4, 0.5]) * (0.7 + 0.6 * RNG.random((61, 47, 3), dtype=np.float32))


@pytest.mark.parametrize("strength", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("percent", [0.05, 2.0])
def test_it_is_red_from_green_then_gray_world_then_a_stretch(strength: float, percent: float):
    image = WATER.astype(np.float64)
    mean = image.mean(axis=(0, 1))
    image[..., 0] += strength * (mean[1] - mean[0]) * (1 - image[..., 0]) * image[..., 1]
    image = np.minimum(image * (image.mean() / image.mean(axis=(0, 1))), 1)
    low, high = np.percentile(image, [percent, 100 - percent], axis=(0, 1))
    expected = ((image - low) / (high - low)).clip(0, 1)
    np.testing.assert_allclose(restored(RedCompensation(strength, percent), WATER), expected, atol=1e-5)


def test_red_is_lifted_and_nothing_where_blue_is_lacking():
    lifted, left = restored(RedCompensation(), WATER), restored(RedCompensation(strength=0), WATER)
    assert np.abs(lifted - left)[..., 0].max() > 0.05
    swapped = np.ascontiguousarray(WATER[..., ::-1])
    np.testing.assert_array_equal(restored(RedCompensation(), swapped), restored(RedCompensation(strength=0), swapped))


def test_a_red_thing_stays_red_and_highlights_stay_the_brightest():
    image = WATER.copy()
    image[8:16, 8:16] = [0.5, 0.15, 0.15]
    image[30:40, 20:30] = 1
    result = restored(RedCompensation(), image)
    assert result[8:16, 8:16].mean(axis=(0, 1)).argmax() == 0
    assert (result[30:40, 20:30] == 1).all()
