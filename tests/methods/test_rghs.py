"""Relative global histogram stretching: its ranges and its colour step, against the publication's formulae."""

import warnings

import numpy as np
import pytest
import skimage.color
from support.forward_model import restored_image as restored

from sucre_bench.methods.rghs import Rghs

RNG = np.random.default_rng(0)
WATER = np.float32([0.15, 0.4, 0.5]) * (0.6 + 0.8 * RNG.random((61, 47, 3), dtype=np.float32))


SPREAD = 0.655136  # of a Rayleigh distribution of mode 1, sqrt((4 - pi) / 2)
KEPT = np.array([1.1, 0.9, 0.9]), np.array([0.83, 0.95, 0.97])  # kappa, and what a metre of water leaves


def by_hand(rgb: np.ndarray, distance_m: float, tail: float) -> np.ndarray:
    """The publication's steps but for the noise filter, in float64, L*a*b* by scikit-image."""
    rgb = rgb.astype(np.float64)
    rgb[..., 1:] *= 0.5 / rgb[..., 1:].mean(axis=(0, 1))
    for c in range(3):
        plane = rgb[..., c]
        values, counts = np.unique(np.rint(plane * 255), return_counts=True)
        mode = values[counts.argmax()] / 255
        left, right = (np.sort(plane[side]) for side in (plane < mode, plane >= mode))
        low = np.interp(tail / 100 * (len(left) - 1), np.arange(len(left)), left)
        high = np.interp((1 - tail / 100) * (len(right) - 1), np.arange(len(right)), right)
        tops = (mode + np.arange(-200, 200) * SPREAD * mode) / (KEPT[0][c] * KEPT[1][c] ** distance_m)
        fitting = tops[(tops >= high) & (tops <= 1)]
        top, bottom = fitting.mean() if len(fitting) else 1, min((1 - SPREAD) * mode, low)
        rgb[..., c] = ((plane - low) * (top - bottom) / (high - low) + bottom).clip(0, 1)
    lab = skimage.color.rgb2lab(rgb)
    low, high = np.percentile(lab[..., 0], [1, 99])
    lab[..., 0] = ((lab[..., 0] - low) * 100 / (high - low)).clip(0, 100)
    lab[..., 1:] *= 1.3 ** (1 - np.abs(lab[..., 1:]) / 128)
    with warnings.catch_warnings(action="ignore"):  # of colours that no screen shows
        return skimage.color.lab2rgb(lab).clip(0, 1)


def image_of(mode: float, low: float, high: float) -> np.ndarray:
    """Each channel spread over [low, high], and a third of it at the mode."""
    planes = [np.r_[RNG.uniform(low, high, 1800), np.full(900, mode)] * factor for factor in (0.5, 0.8, 1)]
    return np.stack([RNG.permutation(plane).reshape(54, 50) for plane in planes], axis=-1).astype(np.float32)


@pytest.mark.parametrize(("distance_m", "tail"), [(3, 0.1), (0, 10), (8, 1)])
@pytest.mark.parametrize(
    "image",
    [WATER, image_of(0.22, 0.1, 0.5), image_of(0.5, 0.02, 0.9), image_of(0.05, 0.01, 0.3), image_of(0.7, 0.6, 0.8)],
    ids=["water", "a range that grows", "a wide range", "dark", "bright"],
)
def test_an_image_is_stretched_as_published(image: np.ndarray, distance_m: float, tail: float):
    found = restored(Rghs(distance_m=distance_m, tail=tail, noise=0), image)
    difference = np.abs(found - by_hand(image, distance_m, tail))
    assert difference.mean() < 0.003  # OpenCV's L*a*b* is approximate
    assert np.percentile(difference, 99) < 0.03


def test_a_red_thing_stays_red_and_highlights_stay_the_brightest():
    image = WATER.copy()
    image[8:16, 8:16] = [0.6, 0.1, 0.1]
    image[30:40, 20:30] = 1
    result = restored(Rghs(), image)
    assert result[10:14, 10:14].mean(axis=(0, 1)).argmax() == 0
    assert result[33:37, 23:27].min() > 0.95 * result.max(axis=(0, 1)).min()


@pytest.mark.parametrize("dead", [0, 1, 2])
def test_a_dead_channel_is_left_alone(dead: int):
    image = WATER.copy()
    image[..., dead] = 0
    result = restored(Rghs(), image)
    assert np.isfinite(result).all()
    assert 0 <= result.min() <= result.max() <= 1
