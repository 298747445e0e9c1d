"""Percentiles of channels, against numpy's sort in float64."""

import numpy as np
import pytest

from sucre_bench.imaging.percentiles import channel_percentiles

Q = [0, 1, 37.5, 99, 100]


def images() -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    wide = rng.normal(0, 1, (31, 57, 3))
    return [wide, wide.round(1), wide.clip(0, 0.5), 1e30 * wide, wide[:1, :1], np.zeros((4, 4, 3)), -np.abs(wide)]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_they_are_numpys_of_every_channel(dtype: type) -> None:
    for image in images():
        image = image.astype(dtype)
        valid = np.random.default_rng(1).random(image.shape[:2]) < 0.7
        valid[0, 0] = True
        expected = np.percentile(image.reshape(-1, 3).astype(np.float64), Q, axis=0)
        np.testing.assert_allclose(channel_percentiles(image, Q), expected, rtol=1e-13, atol=1e-13)
        expected = np.percentile(image[valid].astype(np.float64), Q, axis=0)
        np.testing.assert_allclose(channel_percentiles(image, Q, valid), expected, rtol=1e-13, atol=1e-13)


def test_pixels_that_do_not_count_may_hold_anything() -> None:
    image = np.random.default_rng(2).random((20, 20, 3)).astype(np.float32)
    valid = np.ones((20, 20), bool)
    valid[3:9] = False
    holed = image.copy()
    holed[3:9] = np.nan
    np.testing.assert_array_equal(channel_percentiles(holed, Q, valid), channel_percentiles(image[valid], Q))
