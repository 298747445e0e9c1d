"""The underwater light attenuation prior, against its formulas computed by hand."""

import numpy as np
import pytest
from support.forward_model import restored, transmission_of

from sucre_bench import InputError
from sucre_bench.methods.ulap import Ulap, depth_prior


@pytest.mark.parametrize(
    ("colour", "expected"),
    [
        ((0, 0, 0), 0.51157954),
        ((1, 0, 0), -0.39353163),
        ((0, 1, 0), 1.01674119),
        ((0, 0, 1), 1.01674119),
        ((0.2, 0.4, 0.6), 0.63365430),  # .51157954 + .30309699 - .18102223
        ((100 / 255, 200 / 255, 50 / 255), 0.55283920),  # of 8 bits: not divided as integers
    ],
)
def test_depth_is_linear_in_red_and_in_the_stronger_of_green_and_blue(colour: tuple[float, ...], expected: float):
    image = np.tile(np.float32(colour), (2, 3, 1))
    np.testing.assert_allclose(depth_prior(image), expected, atol=2e-6)


def test_a_colour_and_its_mirror_in_bgr_have_other_depths() -> None:
    red = np.full((1, 1, 3), [0.8, 0.3, 0.1], np.float32)
    assert depth_prior(red[..., ::-1])[0, 0] - depth_prior(red)[0, 0] == pytest.approx(
        0.50516165 * 0.5 + 0.90511117 * 0.7, abs=1e-6
    )


def test_the_veiling_light_is_the_brightest_of_the_deepest_pixels() -> None:
    """The deepest tenth is the top row; within it, the position of the brightest is a row and a column, no channel."""
    image = np.full((10, 10, 3), [0.9, 0.5, 0.4], np.float32)
    image[0] = 0.1, 0.6, 0.7
    image[0, 7] = 0.1, 0.7, 0.7
    result = restored(Ulap(share=0.1, radius=1, eps=1e-6), image)
    np.testing.assert_allclose(result.water.veiling_light, image[0, 7], atol=1e-6)


def test_the_transmission_of_each_channel_is_what_remains_after_the_stretched_depth() -> None:
    near, far = np.array([0.6, 0.5, 0.4]), np.array([0.1, 0.6, 0.7])
    image = np.empty((40, 90, 3), np.float32)
    image[:, :30], image[:, 30:60], image[:, 60:] = near, (near + far) / 2, far
    result = restored(Ulap(radius=3, eps=1e-6, greatest=1), image)
    prior = [0.51157954 + 0.50516165 * max(c[1:]) - 0.90511117 * c[0] for c in (near, (near + far) / 2, far)]
    nearest = 1 - 0.5 / 0.9  # red differs most from the veiling light, .1, and could by .9
    t = transmission_of(image, result)
    for columns, depth in ((slice(5, 25), 0.0), (slice(35, 55), (prior[1] - prior[0]) / (prior[2] - prior[0]))):
        expected = np.array([0.83, 0.95, 0.97]) ** (8 * (depth + nearest))
        np.testing.assert_allclose(t[:, columns].reshape(-1, 3), np.tile(expected, (800, 1)), atol=2e-3)


def test_what_is_farther_lets_less_through() -> None:
    depth = np.linspace(0, 8, 120)[:, None, None] * np.ones((1, 80, 1))
    grain = np.random.default_rng(0).uniform(0.5, 0.6, (120, 80, 1))
    through = np.exp(-depth * [0.3, 0.05, 0.04])
    image = (grain * through + np.array([0.05, 0.5, 0.6]) * (1 - through)).astype(np.float32)
    t = np.nanmean(transmission_of(image, restored(Ulap(radius=5), image))[:60, :, 0], axis=1)
    assert t[:20].mean() > t[20:40].mean() > t[40:].mean()


@pytest.mark.parametrize("remaining", [(), (0.8, 0.9), (0.8, 0.9, 0.9, 0.9)])
def test_what_remains_of_other_than_three_channels_is_refused(remaining: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match=r"^ulap\.remaining: \("):
        Ulap(remaining=remaining)
