"""Blending over scales, against the weighted mean and the identities it must keep."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from sucre_bench.imaging.filters import blended, most_levels

RNG = np.random.default_rng(0)
SIZES = [(61, 47), (48, 64), (33, 2), (4, 6), (1, 1), (1, 9)]


def images(size: tuple[int, int], count: int = 2) -> list[np.ndarray]:
    return [RNG.random((*size, 3), dtype=np.float32) for _ in range(count)]


def random_weights(size: tuple[int, int], count: int = 2) -> np.ndarray:
    weights = RNG.random((count, *size), dtype=np.float32) + np.float32(0.01)
    return weights / weights.sum(axis=0)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("levels", [1, 3, 9])
def test_with_constant_weights_it_is_the_weighted_mean(size: tuple[int, int], levels: int):
    inputs = images(size, 3)
    shares = [0.2, 0.5, 0.3]
    weights = [np.full(size, share, np.float32) for share in shares]
    expected = sum(share * image.astype(np.float64) for share, image in zip(shares, inputs, strict=True))
    np.testing.assert_allclose(blended(inputs, weights, levels), expected, atol=2e-6)


@pytest.mark.parametrize("size", SIZES)
def test_equal_images_are_given_back_whatever_their_weights_and_size(size: tuple[int, int]):
    (image,) = images(size, 1)
    result = blended([image, image], random_weights(size), 5)
    assert result.dtype == np.float32
    np.testing.assert_allclose(result, image, atol=2e-6)


def test_one_level_is_the_mean_pixel_by_pixel():
    inputs, weights = images((9, 7)), random_weights((9, 7))
    expected = np.einsum("khw,khwc->hwc", weights.astype(np.float64), np.stack(inputs))
    np.testing.assert_allclose(blended(inputs, weights, 1), expected, atol=1e-6)


def test_where_weights_jump_more_levels_make_a_wider_transition():
    dark, bright = (np.full((64, 64, 3), value, np.float32) for value in (0.2, 0.8))
    left = np.zeros((64, 64), np.float32)
    left[:, :32] = 1
    steepest = []
    for levels in (1, 3, 5):
        row = blended([dark, bright], [left, 1 - left], levels)[32, :, 0]
        assert row[0] == pytest.approx(0.2, abs=0.03)
        assert row[-1] == pytest.approx(0.8, abs=0.03)
        steepest.append(np.abs(np.diff(row)).max())
    assert steepest[0] == pytest.approx(0.6, abs=1e-6)
    assert steepest[1] < 0.3 * steepest[0]
    assert steepest[2] < 0.3 * steepest[1]


def test_coarse_bands_are_weighted_by_smoothed_weights():
    """Black and white have no detail: at two levels what is left is the weight, reduced and enlarged."""
    weight = RNG.random((21, 17), dtype=np.float32)
    kernel = np.outer([1, 4, 6, 4, 1], [1, 4, 6, 4, 1]) / 256
    enlarged = np.zeros(weight.shape)
    enlarged[::2, ::2] = 4 * ndimage.correlate(weight.astype(np.float64), kernel, mode="mirror")[::2, ::2]
    enlarged = ndimage.correlate(enlarged, kernel, mode="mirror")
    white, black = np.ones((21, 17, 3), np.float32), np.zeros((21, 17, 3), np.float32)
    found = blended([white, black], [weight, 1 - weight], 2)
    np.testing.assert_allclose(found[2:-2, 2:-2, 1], enlarged[2:-2, 2:-2], atol=1e-5)


def test_fine_detail_follows_the_weights_where_it_is():
    """Left half from an image with stripes, right half from a flat one: far from the seam, each is as it was."""
    stripes = np.zeros((64, 256, 3), np.float32)
    stripes[::2] = 1
    flat = np.full_like(stripes, 0.5)
    left = np.zeros((64, 256), np.float32)
    left[:, :128] = 1
    result = blended([stripes, flat], [left, 1 - left], 4)
    np.testing.assert_allclose(result[:, :80], stripes[:, :80], atol=1e-3)
    np.testing.assert_allclose(result[:, 176:], 0.5, atol=1e-3)


def test_it_leaves_its_input_alone():
    inputs, weights = images((16, 16)), random_weights((16, 16))
    for array in (*inputs, weights):
        array.setflags(write=False)
    blended(inputs, weights, 4)


@pytest.mark.parametrize(
    ("shape", "levels"),
    [((1, 1), 1), ((2, 3), 1), ((4, 6), 2), ((61, 47), 5), ((4000, 6000), 11)],
)
def test_an_image_has_room_for_as_many_levels_as_it_can_be_halved(shape: tuple[int, int], levels: int):
    assert most_levels(shape) == levels
