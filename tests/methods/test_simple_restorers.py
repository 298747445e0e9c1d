"""The simple restorers, against what their definitions say."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import skimage.color
from skimage.color import lab2rgb, rgb2lab
from support.forward_model import alone, restored_image as restored
from support.made_scene import make_scene

from sucre_bench import Arrays, InputError, View
from sucre_bench.imaging.cielab import to_lab
from sucre_bench.methods.clahe import Clahe
from sucre_bench.methods.gray_world import GrayWorld
from sucre_bench.methods.histogram_stretch import HistogramStretch
from sucre_bench.methods.mlle import Mlle, corrected
from sucre_bench.methods.red_compensation import RedCompensation
from sucre_bench.methods.rghs import Rghs
from sucre_bench.methods.stitching import Stitching
from sucre_bench.methods.underwater import Underwater
from sucre_bench.multiview.pairing import lift, match

SCENE = make_scene()
TARGET = SCENE["a.png"]


def photo(rgb: np.ndarray, depth: np.ndarray | None = None) -> View:
    return View("photo.png", Arrays(rgb, depth))


def test_underwater_is_the_input() -> None:
    assert np.array_equal(Underwater().restore(SCENE, TARGET).image, TARGET.rgb)


ROWS_BELOW_2 = np.repeat([[0.0], [0], [1], [1], [1]], 7, axis=1)


@pytest.mark.parametrize("depth", [None, np.zeros((5, 7)), ROWS_BELOW_2])
def test_gray_world_makes_the_means_over_valid_pixels_equal(depth: np.ndarray | None) -> None:
    """Over all of them where no depth is known."""
    rgb = np.random.default_rng(0).uniform(0.1, 0.5, (5, 7, 3)) * [0.2, 1, 0.8]
    view = photo(rgb, depth)
    counted = slice(2, None) if depth is ROWS_BELOW_2 else slice(None)
    image = GrayWorld().restore(alone(view), view).image
    np.testing.assert_allclose(image[counted].mean(axis=(0, 1)), rgb[counted].mean(), rtol=1e-5)
    assert np.isfinite(image).all()
    assert image.dtype == np.float32


def test_gray_world_leaves_a_black_channel_black() -> None:
    image = restored(GrayWorld(), RNG.uniform(0.1, 0.5, (5, 7, 3)) * [0, 1, 0.8])
    assert not image[..., 0].any()
    assert np.isfinite(image).all()
    assert image[..., 1].mean() == pytest.approx(image[..., 2].mean(), rel=1e-5)


def test_the_stretch_takes_its_percentiles_over_valid_pixels() -> None:
    rgb = np.zeros((1, 103, 3))
    rgb[0, :101] = np.linspace(0.2, 0.7, 101)[:, None]
    rgb[0, 101], rgb[0, 102] = 0.1, 0.45  # neither has depth
    view = photo(rgb, np.array([[1.0] * 101 + [0.0] * 2]))
    image = HistogramStretch(low=10, high=90).restore(alone(view), view).image
    np.testing.assert_allclose(image[0, 10::10, 1], [0, *np.arange(1, 8) / 8, 1, 1], atol=1e-6)
    np.testing.assert_allclose(image[0, 101:, 1], [0, 0.5], atol=1e-6)


@pytest.mark.parametrize(("low", "high"), [(-1, 99), (50, 50), (1, 101)])
def test_the_stretch_refuses_percentiles_that_are_none(low: float, high: float) -> None:
    with pytest.raises(InputError, match=r"^histogram_stretch: .*use 0 <= low < high <= 100"):
        HistogramStretch(low=low, high=high)


def test_stitching_takes_the_closest_observation() -> None:
    nearest = {
        p: (TARGET.distance.ravel()[p], TARGET.rgb.reshape(-1, 3)[p])
        for p in np.flatnonzero(TARGET.depth)
    }
    for view in SCENE:
        if view is not TARGET:
            found = match(lift(TARGET), view)
            for pixel, other, z in zip(found.pixels, found.others, found.distance, strict=True):
                if z < nearest[pixel][0]:
                    nearest[pixel] = (z, view.rgb.reshape(-1, 3)[other])
    image = Stitching().restore(SCENE, TARGET).image
    for pixel, (_, colour) in nearest.items():
        np.testing.assert_allclose(image.reshape(-1, 3)[pixel], colour, atol=1e-6)
    assert (image != TARGET.rgb)[TARGET.valid].any(
        axis=-1
    ).mean() > 0.3  # a nearer view did help


RNG = np.random.default_rng(0)
DULL = np.float32([0.2, 0.4, 0.45]) + np.float32(0.1) * RNG.random(
    (64, 80, 1), dtype=np.float32
)


def test_contrast_rises_and_colour_is_kept():
    """Taken for BGR, the lightness and the hue of a bluish image would be those of another."""
    before, after = to_lab(DULL), to_lab(restored(Clahe(), DULL))
    assert after[..., 0].std() > 1.5 * before[..., 0].std()
    np.testing.assert_allclose(after[..., 1:], before[..., 1:], atol=0.6)


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
    np.testing.assert_allclose(
        restored(RedCompensation(strength, percent), WATER), expected, atol=1e-5
    )


RED_LOST = np.float32([0.15, 0.4, 0.5]) * (
    0.6 + 0.8 * RNG.random((61, 47, 3), dtype=np.float32)
)
SPREAD = 0.655136  # of a Rayleigh distribution of mode 1, sqrt((4 - pi) / 2)
# kappa, and what a metre of water leaves
KEPT = (
    np.array([1.1, 0.9, 0.9]),
    np.array([0.83, 0.95, 0.97]),
)


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
        tops = (mode + np.arange(-200, 200) * SPREAD * mode) / (
            KEPT[0][c] * KEPT[1][c] ** distance_m
        )
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
    planes = [
        np.r_[RNG.uniform(low, high, 1800), np.full(900, mode)] * factor
        for factor in (0.5, 0.8, 1)
    ]
    return np.stack(
        [RNG.permutation(plane).reshape(54, 50) for plane in planes], axis=-1
    ).astype(np.float32)


@pytest.mark.parametrize(("distance_m", "tail"), [(3, 0.1), (0, 10), (8, 1)])
@pytest.mark.parametrize(
    "image",
    [
        RED_LOST,
        image_of(0.22, 0.1, 0.5),
        image_of(0.5, 0.02, 0.9),
        image_of(0.05, 0.01, 0.3),
        image_of(0.7, 0.6, 0.8),
    ],
    ids=["water", "a range that grows", "a wide range", "dark", "bright"],
)
def test_an_image_is_stretched_as_published(image: np.ndarray, distance_m: float, tail: float):
    found = restored(Rghs(distance_m=distance_m, tail=tail, noise=0), image)
    difference = np.abs(found - by_hand(image, distance_m, tail))
    assert difference.mean() < 0.003  # OpenCV's L*a*b* is approximate
    assert np.percentile(difference, 99) < 0.03


MURK = np.float32([0.1, 0.5, 0.4]) * (0.7 + 0.6 * RNG.random((41, 57, 3), dtype=np.float32))


def by_blocks(light: np.ndarray, side: int, contrast: float) -> np.ndarray:
    """Each pixel's lightness moved from its block's mean, pixel by pixel."""
    result = np.empty_like(light)
    for y, x in np.ndindex(*light.shape):
        block = light[
            max(0, y - side // 2) : y + side // 2 + 1, max(0, x - side // 2) : x + side // 2 + 1
        ]
        gain = min(light.var() / max(block.var(), 1e-8), contrast)
        result[y, x] = block.mean() + gain * (light[y, x] - block.mean())
    return result


@pytest.mark.parametrize(
    "murk", [0.5 + MURK[..., ::-1] / 4, MURK], ids=["a is raised", "b is raised"]
)
def test_the_whole_is_its_steps(murk: np.ndarray) -> None:
    lab = rgb2lab(corrected(murk, 1.2).clip(0, 1).astype(np.float64))
    light = by_blocks(lab[..., 0] / 100, 25, 2)
    low, high = np.percentile(light, [1, 99])
    a, b = lab[..., 1:].mean(axis=(0, 1)) + 128
    lab[..., 0] = 100 * ((light - low) / (high - low)).clip(0, 1)
    lab[..., 1] = (lab[..., 1] + 128) * (1 + max(0, b - a) / (a + b)) - 128
    lab[..., 2] = (lab[..., 2] + 128) * (1 + max(0, a - b) / (a + b)) - 128
    result = restored(Mlle(), murk)
    # OpenCV's L*a*b* is approximate
    assert np.abs(result - lab2rgb(lab).clip(0, 1)).mean() < 5e-3
