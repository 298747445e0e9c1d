"""Fusion restorers: their inputs and weights against the publications' equations in float64."""

import numpy as np
from scipy import ndimage
from skimage.color import rgb2lab
from support.forward_model import restored_image as restored

from sucre_bench.methods.fusion import (
    Fusion2012,
    Fusion2018,
    saliency,
    sharpened,
    weight_2012,
    weight_2018,
)

RNG = np.random.default_rng(0)
IMAGE = RNG.random((13, 17, 3), dtype=np.float32)
KERNEL = np.outer([1, 4, 6, 4, 1], [1, 4, 6, 4, 1]) / 256


def filtered(plane: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """Correlation in float64, the image mirrored about its outermost pixels."""
    return ndimage.correlate(plane.astype(np.float64), kernel, mode="mirror")


def saliency_by_hand(rgb: np.ndarray) -> np.ndarray:
    lab = rgb2lab(rgb.astype(np.float64)) / 100
    smooth = np.stack([filtered(lab[..., c], KERNEL) for c in range(3)], axis=-1)
    return np.sqrt(((smooth - lab.mean(axis=(0, 1))) ** 2).sum(axis=-1))


def luminance(rgb: np.ndarray) -> np.ndarray:
    return rgb.astype(np.float64) @ [0.299, 0.587, 0.114]


def laplacian(light: np.ndarray) -> np.ndarray:
    return np.abs(filtered(light, np.array([[0, 1, 0], [1, -4, 1], [0, 1, 0]], np.float64)))


def test_saliency_is_the_distance_of_the_smoothed_colour_from_the_mean_colour():
    # OpenCV's L*a*b* is approximate
    np.testing.assert_allclose(saliency(IMAGE), saliency_by_hand(IMAGE), atol=3e-3)


def test_the_weights_of_2012_are_its_four_measures():
    light = luminance(IMAGE)
    contrast = (light - filtered(light, KERNEL)) ** 2
    exposed = np.exp(-((light - 0.5) ** 2) / (2 * 0.25**2))
    expected = laplacian(light) + contrast + saliency(IMAGE) + exposed
    np.testing.assert_allclose(weight_2012(IMAGE), expected, atol=2e-5)


def test_the_weights_of_2018_are_its_three_measures():
    light = luminance(IMAGE)
    saturation = np.sqrt(((IMAGE - light[..., None]) ** 2).sum(axis=-1) / 3)
    expected = laplacian(light) + saliency(IMAGE) + saturation
    np.testing.assert_allclose(weight_2018(IMAGE), expected, atol=2e-5)


def test_a_dead_channel_gains_no_noise():
    nearly_dead = IMAGE * np.float32([0, 1, 1]) + np.float32([0.002, 0, 0]) * RNG.random(
        (13, 17, 3), dtype=np.float32
    )
    shifted, stretched = (
        restored(Fusion2012(balance=kind), nearly_dead)[..., 0] for kind in ("shift", "stretch")
    )
    assert shifted.std() < 0.5 * stretched.std()


def test_the_sharpened_input_is_the_mean_of_the_image_and_its_stretched_detail():
    image = IMAGE.astype(np.float64)
    detail = image - ndimage.gaussian_filter(image, 2, mode="mirror", axes=(0, 1), truncate=4)
    # one range for the three channels
    stretched = (detail - detail.min()) / (detail.max() - detail.min())
    np.testing.assert_allclose(sharpened(IMAGE, 2), (image + stretched) / 2, atol=2e-4)


def test_blue_is_lifted_where_it_is_asked_for_and_lacking():
    """Red and blue compensated are mirror images: an image with the two swapped is restored with the two swapped."""
    greenish = np.float32([0.1, 0.5, 0.2]) * (
        0.7 + 0.6 * RNG.random((32, 32, 3), dtype=np.float32)
    )
    both = Fusion2018(red=0.4, blue=0.8)
    mean = greenish.mean(axis=(0, 1), dtype=np.float64)
    red, green, blue = (greenish[..., c].astype(np.float64) for c in range(3))
    by_hand = np.stack(
        [
            red + 0.4 * (mean[1] - mean[0]) * (1 - red) * green,
            green,
            blue + 0.8 * (mean[1] - mean[2]) * (1 - blue) * green,
        ],
        axis=-1,
    )
    np.testing.assert_allclose(
        restored(both, greenish), restored(Fusion2018(red=0), by_hand), atol=1e-4
    )
