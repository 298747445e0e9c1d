"""MLLE against its steps in float64: the publication's iteration, brute-force blocks, another package's L*a*b*."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from skimage.color import lab2rgb, rgb2lab
from support.forward_model import restored

from sucre_bench.methods.mlle import Mlle, balanced_chroma, colour_transfer, corrected, enhanced_lightness

RNG = np.random.default_rng(0)
WATER = np.float32([0.1, 0.5, 0.4]) * (0.7 + 0.6 * RNG.random((41, 57, 3), dtype=np.float32))


def transferred(rgb: np.ndarray) -> np.ndarray:
    """The colour transfer image by the publication's iteration, in float64."""
    even = rgb.astype(np.float64)
    strongest = even.mean(axis=(0, 1)).argmax()
    for _ in range(200):
        lacking = even[..., strongest].mean() - even.mean(axis=(0, 1))
        even = even + lacking * even[..., strongest, None]
    low, high = even.min(axis=(0, 1)), even.max(axis=(0, 1))
    return (even - low) / (high - low)


def by_blocks(light: np.ndarray, side: int, contrast: float) -> np.ndarray:
    """Each pixel's lightness moved from its block's mean, pixel by pixel."""
    result = np.empty_like(light)
    for y, x in np.ndindex(*light.shape):
        block = light[max(0, y - side // 2) : y + side // 2 + 1, max(0, x - side // 2) : x + side // 2 + 1]
        gain = min(light.var() / max(block.var(), 1e-8), contrast)
        result[y, x] = block.mean() + gain * (light[y, x] - block.mean())
    return result


def test_the_colour_transfer_image_is_the_limit_of_the_published_iteration() -> None:
    np.testing.assert_allclose(colour_transfer(WATER), transferred(WATER), atol=1e-5)


def test_colours_are_replaced_most_where_a_channel_is_dark() -> None:
    rgb = WATER.astype(np.float64)
    share = 1 - rgb.min(axis=-1, keepdims=True) ** 1.2
    detail = rgb - gaussian_filter(rgb, 1, mode="mirror", axes=(0, 1))
    expected = detail + share * transferred(rgb) + (1 - share) * rgb
    np.testing.assert_allclose(corrected(WATER, 1.2), expected, atol=5e-3)  # OpenCV cuts the Gaussian at 3 sigma


@pytest.mark.parametrize("side", [3, 25])
def test_lightness_moves_from_the_mean_of_its_block_by_no_more_than_the_greatest_gain(side: int) -> None:
    light = RNG.random((30, 40)) * np.linspace(0.05, 1, 40)  # smooth blocks on the left, rough ones on the right
    enhanced = enhanced_lightness(light.astype(np.float32), side, 2)
    np.testing.assert_allclose(enhanced, by_blocks(light, side, 2), atol=1e-4)


def test_the_lower_of_the_two_chroma_means_is_raised() -> None:
    chroma = np.float32([-20, 10]) + RNG.normal(0, 3, (20, 30, 2)).astype(np.float32)
    raised = balanced_chroma(chroma)
    a, b = chroma.astype(np.float64).mean(axis=(0, 1)) + 128
    np.testing.assert_allclose(raised[..., 0].mean() + 128, a * (1 + (b - a) / (a + b)), rtol=1e-4)
    np.testing.assert_allclose(raised[..., 1], chroma[..., 1], atol=1e-4)
    swapped = balanced_chroma(chroma[..., ::-1])
    np.testing.assert_allclose(swapped[..., ::-1], raised, atol=1e-4)


def test_the_whole_is_its_steps() -> None:
    lab = rgb2lab(corrected(WATER, 1.2).clip(0, 1).astype(np.float64))
    light = by_blocks(lab[..., 0] / 100, 25, 2)
    low, high = np.percentile(light, [1, 99])
    a, b = lab[..., 1:].mean(axis=(0, 1)) + 128
    lab[..., 0] = 100 * ((light - low) / (high - low)).clip(0, 1)
    lab[..., 1] = (lab[..., 1] + 128) * (1 + max(0, b - a) / (a + b)) - 128
    lab[..., 2] = (lab[..., 2] + 128) * (1 + max(0, a - b) / (a + b)) - 128
    result = restored(Mlle(), WATER).image
    assert np.abs(result - lab2rgb(lab).clip(0, 1)).mean() < 5e-3  # OpenCV's L*a*b* is approximate


def test_a_cast_shrinks_and_contrast_grows() -> None:
    hazy = 0.3 * WATER + np.float32([0.05, 0.45, 0.4])
    result = restored(Mlle(), hazy).image
    assert np.ptp(result.mean(axis=(0, 1))) < 0.5 * np.ptp(hazy.mean(axis=(0, 1)))
    assert result.std() > 2 * hazy.std(axis=(0, 1)).mean()
