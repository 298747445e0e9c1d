"""Display normalisations and the sRGB curve."""

from __future__ import annotations

import numpy as np
import pytest

from sucre_bench import InputError
from sucre_bench.imaging.display import display
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode

IMAGE = np.random.default_rng(0).uniform(-0.1, 1.3, (40, 50, 3))


def test_the_srgb_curve_is_the_standards_and_inverts_beyond_its_range() -> None:
    assert srgb_encode(np.array(0.5)) == pytest.approx(0.735357, abs=1e-6)  # IEC 61966-2-1
    assert srgb_decode(np.array(0.5)) == pytest.approx(0.214041, abs=1e-6)
    np.testing.assert_allclose(srgb_encode(srgb_decode(IMAGE)), IMAGE, atol=1e-12)


def test_white_scales_each_channel_by_its_percentile_and_leaves_black() -> None:
    image = IMAGE * [0.2, 0.5, 1.0]
    shown = display(image, "white-99")
    expected = (image / np.percentile(image.reshape(-1, 3), 99, axis=0)).clip(0, 1)
    np.testing.assert_allclose(shown, expected, atol=1e-6)
    assert (shown[image <= 0] == 0).all()


def test_white_leaves_a_channel_without_light_alone() -> None:
    image = np.dstack([np.zeros((5, 5)), np.full((5, 5), 0.5), np.full((5, 5), -0.1)])
    np.testing.assert_allclose(display(image, "white-99")[0, 0], [0, 1, 0])


def test_a_linear_stretch_is_a_stretch_of_light() -> None:
    light = srgb_decode(IMAGE)
    low, high = np.percentile(light.reshape(-1, 3), [1, 99], axis=0)
    expected = srgb_encode(((light - low) / (high - low)).clip(0, 1))
    np.testing.assert_allclose(display(IMAGE, "linear-stretch-1-99"), expected, atol=1e-6)
    np.testing.assert_allclose(display(light, "linear-stretch-1-99", "linear"), expected, atol=1e-6)


@pytest.mark.parametrize("how", ["white", "white-0", "white-101", "linear-stretch", "linear-white-99", "stretch-99-1"])
def test_other_names_are_refused_with_those_there_are(how: str) -> None:
    with pytest.raises(InputError, match=f"^display '{how}': unknown; use none, gray-world or stretch-LOW-HIGH"):
        display(IMAGE, how)
