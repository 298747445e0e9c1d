"""Restoration by blurriness and light absorption, against its formulas computed by hand."""

import cv2
import numpy as np
import pytest
from support.forward_model import hazy, restored, transmission_of

from sucre_bench.methods.ibla import (
    Ibla,
    attenuation_ratio,
    least_block,
    relative_depth,
    sharpness_map,
    sigmoid,
    veiling_light_of,
)

RNG = np.random.default_rng(0)
WATER = np.array([0.08, 0.45, 0.6])


def made() -> tuple[np.ndarray, np.ndarray]:
    """Speckled ground, 1 m off at the lower border, 12 m at the upper and blurred there: image, metres."""
    z = np.linspace(12, 1, 150)[:, None] * np.ones((1, 200))
    speckles = RNG.random((150, 200, 1)) * [0.9, 0.8, 0.7]
    blurred = np.stack(
        [cv2.GaussianBlur(speckles, (0, 0), 0.3 * m)[y] for y, m in enumerate(z[:, 0])]
    )
    return hazy(blurred, WATER, np.exp(-z[..., None] * [0.4, 0.12, 0.1])).astype(np.float32), z


def test_the_ratio_of_attenuation_is_that_of_the_wavelengths_and_the_veiling_light() -> None:
    """By hand: m l + i = .92457, 1.01497, 1.11667; .2 * 1.01497 / (.5 * .92457), .2 * 1.11667 / (.6 * .92457)."""
    ratio = attenuation_ratio(np.array([0.2, 0.5, 0.6]))
    np.testing.assert_allclose(ratio, [1, 0.439110, 0.402591], atol=1e-6)
    # blue scatters more: the wavelengths are not swapped
    assert attenuation_ratio(np.array([0.3, 0.3, 0.3]))[2] > 1


def test_a_veiling_light_without_red_still_gives_green_and_blue_an_attenuation() -> None:
    """Channels below 0.1 count as 0.1: U45's published pictures of this method are explained by that alone."""
    expected = attenuation_ratio(np.array([0.1, 0.5, 0.6]))
    np.testing.assert_allclose(attenuation_ratio(np.array([0.01, 0.5, 0.6])), expected)
    dark = attenuation_ratio(np.array([0.02, 0.05, 0.01]))
    np.testing.assert_allclose(dark, [1, 1.01497 / 0.92457, 1.11667 / 0.92457], rtol=1e-5)


def test_red_is_attenuated_by_a_seventh_a_metre_and_the_others_in_their_ratio() -> None:
    image, _ = made()
    result = restored(Ibla(least=1e-6), image)
    t = transmission_of(image, result)
    log = np.log(t[np.isfinite(t).all(axis=-1)])
    assert len(log) > 1000
    ratio = attenuation_ratio(result.water.veiling_light)
    np.testing.assert_allclose(np.median(log / log[:, :1], axis=0), ratio, rtol=0.01)
    np.testing.assert_allclose(result.info["attenuation"], ratio / 7)


def test_the_veiling_light_of_a_far_end_is_found() -> None:
    water = restored(Ibla(), made()[0]).water
    np.testing.assert_allclose(water.veiling_light, WATER, atol=0.1)


def test_blurriness_is_the_mean_difference_from_the_gaussians() -> None:
    """A lone bright pixel differs from each of its blurs by all but the kernel's middle; far off, there is nothing."""
    gray = np.zeros((141, 141), np.float32)
    gray[70, 70] = 1
    left = []
    for size in (9, 17, 33, 65):
        line = np.exp(-((np.arange(size) - size // 2) ** 2) / (2 * size**2))
        left.append(1 - (1 / line.sum()) ** 2)
    sharpness = sharpness_map(gray, scales=4, window=7)
    # the maximum of a 7 x 7 window
    np.testing.assert_allclose(sharpness[67:74, 67:74], np.mean(left), rtol=1e-4)
    assert sharpness[:30].max() == 0


def test_dark_detail_is_as_sharp_as_bright_detail() -> None:
    """In unsigned integers, one of the two differences would wrap around."""
    gray = RNG.random((40, 50), dtype=np.float32)
    np.testing.assert_allclose(sharpness_map(1 - gray, 4, 7), sharpness_map(gray, 4, 7), atol=1e-5)


def test_a_smooth_patch_within_an_object_is_as_near_as_the_object() -> None:
    gray = np.full((160, 160), 0.5, np.float32)
    gray[20:140, 20:140] = RNG.random((120, 120))
    gray[60:100, 60:100] = 0.5
    sharpness = sharpness_map(gray, scales=1, window=7)
    assert sharpness[80, 80] > 0.1 > sharpness[2, 2]


def test_the_block_of_least_variance_is_searched_quarter_by_quarter() -> None:
    plane = RNG.random((128, 96))
    plane[64:, :48] = 0.7
    block = plane[least_block(plane, np.var)]
    assert block.size < 4 * plane.size / 1024
    np.testing.assert_array_equal(block, 0.7)


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (2, 2), (3, 2), (5, 400)])
def test_the_search_for_a_block_ends_in_images_of_any_size(size: tuple[int, int]) -> None:
    assert RNG.random(size)[least_block(RNG.random(size), np.mean)].size >= 1


@pytest.mark.parametrize(("level", "expected"), [(0.3, "least"), (0.8, "greatest")])
def test_the_veiling_light_is_the_least_candidate_in_dark_water_and_the_greatest_in_bright(
    level: float, expected: str
):
    """The flat quarter is the block of least variance, the corner what is most blurred."""
    rgb = (level + RNG.uniform(-0.1, 0.1, (64, 64, 1)) * np.ones(3)).astype(np.float32)
    rgb[:33, :33] = level - 0.05
    rgb[33:, 33:] = level + 0.05 + 0.001 * RNG.random((31, 31, 1), dtype=np.float32)
    sharpness = np.ones((64, 64), np.float32)
    sharpness[33:, 33:] = 0.1
    A = veiling_light_of(rgb, sharpness)
    np.testing.assert_allclose(A, level + (0.05 if expected == "greatest" else -0.05), atol=2e-3)


def test_the_sigmoid_is_a_half_at_its_middle() -> None:
    assert sigmoid(0.2, 0.2) == pytest.approx(0.5)
    assert sigmoid(0.3, 0.2) == pytest.approx(0.9608343)  # 1 / (1 + e^-3.2)


def test_depth_is_from_red_where_there_is_red_and_from_blurriness_where_there_is_none() -> None:
    red = np.zeros((20, 30, 3), np.float32)
    red[:, :15, 0], red[:, 15:, 0] = 0.8, 0.2
    blurred_left = np.where(np.arange(30) < 15, 0.0, 1.0) * np.ones((20, 1))
    dark_water = np.array([0.05, 0.2, 0.2])
    by_red = relative_depth(red, blurred_left.astype(np.float32), dark_water, 3)
    assert by_red[5, 5] == pytest.approx(0, abs=1e-4)
    assert by_red[5, 25] == pytest.approx(1, abs=1e-4)
    by_blur = relative_depth(red[..., ::-1], blurred_left.astype(np.float32), dark_water, 3)
    assert by_blur[5, 5] > 0.95 > 0.05 > by_blur[5, 25]


def test_in_bright_water_depth_is_how_little_red_exceeds_green_and_blue() -> None:
    rgb = np.full((20, 30, 3), 0.5, np.float32)
    rgb[:, 15:] = [0.6, 0.9, 0.9]  # more red than on the left, but less of it beside green and blue
    flat = np.zeros((20, 30), np.float32)
    assert relative_depth(rgb, flat, np.full(3, 0.9), 3)[5, 25] == pytest.approx(1, abs=1e-3)
    assert relative_depth(rgb, flat, np.full(3, 0.1), 3)[5, 25] == pytest.approx(0, abs=1e-3)


def test_estimating_on_a_reduced_image_changes_little() -> None:
    rgb = cv2.resize(made()[0], (800, 600), interpolation=cv2.INTER_CUBIC).clip(0, 1)
    small, whole = (restored(Ibla(work_px=px), rgb) for px in (400, 800))
    assert np.abs(small.image - whole.image).mean() < 0.05
