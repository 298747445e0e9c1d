"""Restoration by blurriness and light absorption, against its formulas computed by hand."""

import cv2
import numpy as np
import pytest
from support.forward_model import hazy, restored, transmission_of

from sucre_bench.methods.ibla import (
    Ibla,
    attenuation_ratio,
    relative_depth,
    sharpness_map,
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


def test_red_is_attenuated_by_a_seventh_a_metre_and_the_others_in_their_ratio() -> None:
    image, _ = made()
    result = restored(Ibla(least=1e-6), image)
    t = transmission_of(image, result)
    log = np.log(t[np.isfinite(t).all(axis=-1)])
    assert len(log) > 1000
    ratio = attenuation_ratio(result.water.veiling_light)
    np.testing.assert_allclose(np.median(log / log[:, :1], axis=0), ratio, rtol=0.01)
    np.testing.assert_allclose(result.info["attenuation"], ratio / 7)


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
