"""Display normalisations and the sRGB curve."""

from __future__ import annotations

import numpy as np
import pytest

from sucre_bench import InputError
from sucre_bench.arrays import locked, once
from sucre_bench.imaging.display import display
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.imaging.percentiles import channel_percentiles
from sucre_bench.scene import Water

IMAGE = np.random.default_rng(0).uniform(-0.1, 1.3, (40, 50, 3))


def test_the_srgb_curve_is_the_standards_and_inverts_beyond_its_range() -> None:
    assert srgb_encode(np.array(0.5)) == pytest.approx(0.735357, abs=1e-6)  # IEC 61966-2-1
    assert srgb_decode(np.array(0.5)) == pytest.approx(0.214041, abs=1e-6)
    np.testing.assert_allclose(srgb_encode(srgb_decode(IMAGE)), IMAGE, atol=1e-12)


def test_white_leaves_a_channel_without_light_alone() -> None:
    image = np.dstack([np.zeros((5, 5)), np.full((5, 5), 0.5), np.full((5, 5), -0.1)])
    np.testing.assert_allclose(display(image, "white-99")[0, 0], [0, 1, 0])


@pytest.mark.parametrize(
    ("how", "black_percent"), [("white-99", None), ("black-5-white-99", 5)]
)
def test_one_black_for_all_channels_is_subtracted_before_each_is_scaled_to_white(
    how: str, black_percent: float | None
) -> None:
    image = IMAGE * [0.2, 0.5, 1.0] + 0.05
    black = 0 if black_percent is None else np.percentile(image, black_percent)
    white = np.percentile(image.reshape(-1, 3), 99, axis=0)
    expected = ((image - black) / (white - black)).clip(0, 1)
    np.testing.assert_allclose(display(image, how), expected, atol=1e-6)


def test_white_by_the_veil_undoes_the_colour_of_the_light() -> None:
    light = np.array([0.2, 0.7, 0.9])
    # linear light on gray things
    gray = np.random.default_rng(1).uniform(0.1, 0.9, (30, 40, 1)) * light
    rate = np.array([0.3, 0.2, 0.1])
    # whose veil near the camera has the colour of the light
    water = Water(light / rate, np.full(3, 0.2), rate)
    shown = display(srgb_encode(gray), "linear-white-veil", water=water)
    np.testing.assert_allclose(shown, shown[..., :1].repeat(3, axis=-1), atol=1e-5)
    top = np.percentile(gray[..., 0] / 0.2, 99)
    np.testing.assert_allclose(shown, srgb_encode((gray / light / top).clip(0, 1)), atol=1e-5)


def test_white_by_the_veil_needs_a_water() -> None:
    with pytest.raises(InputError, match=r"'linear-white-veil': .*veil"):
        display(IMAGE, "linear-white-veil")


@pytest.mark.parametrize("how", ["stretch-1-99", "white-99", "gray-world", "black-1-white-99"])
def test_views_of_one_scene_are_shown_alike(how: str) -> None:
    dark, bright = IMAGE[:20] * 0.5, IMAGE[20:]
    whole = display(np.concatenate([dark, bright]), how)
    over = np.concatenate([dark, bright]).reshape(-1, 1, 3)
    np.testing.assert_allclose(display(dark, f"{how}@scene", over=over), whole[:20], atol=1e-6)
    np.testing.assert_allclose(
        display(bright, f"{how}@scene", over=over), whole[20:], atol=1e-6
    )


def test_a_linear_stretch_is_a_stretch_of_light() -> None:
    light = srgb_decode(IMAGE)
    low, high = np.percentile(light.reshape(-1, 3), [1, 99], axis=0)
    expected = srgb_encode(((light - low) / (high - low)).clip(0, 1))
    np.testing.assert_allclose(display(IMAGE, "linear-stretch-1-99"), expected, atol=1e-6)
    np.testing.assert_allclose(
        display(light, "linear-stretch-1-99", "linear"), expected, atol=1e-6
    )


@pytest.mark.parametrize(
    "how",
    [
        "white",
        "white-0",
        "white-101",
        "linear-stretch",
        "linear-white-99",
        "stretch-99-1",
        "black-99-white-1",
        "white-99@dive",
    ],
)
def test_other_names_are_refused_with_those_there_are(how: str) -> None:
    with pytest.raises(
        InputError, match=rf"^display '{how}': .*none, gray-world or stretch-LOW-HIGH"
    ):
        display(IMAGE, how)


Q = [0, 1, 37.5, 99, 100]


def images() -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    wide = rng.normal(0, 1, (31, 57, 3))
    return [
        wide,
        wide.round(1),
        wide.clip(0, 0.5),
        1e30 * wide,
        wide[:1, :1],
        np.zeros((4, 4, 3)),
        -np.abs(wide),
    ]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_they_are_numpys_of_every_channel(dtype: type) -> None:
    for image in images():
        image = image.astype(dtype)
        valid = np.random.default_rng(1).random(image.shape[:2]) < 0.7
        valid[0, 0] = True
        expected = np.percentile(image.reshape(-1, 3).astype(np.float64), Q, axis=0)
        np.testing.assert_allclose(
            channel_percentiles(image, Q), expected, rtol=1e-13, atol=1e-13
        )
        expected = np.percentile(image[valid].astype(np.float64), Q, axis=0)
        image[~valid] = np.nan  # what does not count may hold anything
        np.testing.assert_allclose(
            channel_percentiles(image, Q, valid), expected, rtol=1e-13, atol=1e-13
        )


CALLS: list[float] = []


@once
def total(array: np.ndarray, factor: float = 1.0) -> float:
    CALLS.append(factor)
    return float(array.sum() * factor)


def test_a_read_only_array_is_computed_once_for_each_argument() -> None:
    CALLS.clear()
    array = locked(np.ones(3))
    assert [total(array), total(array), total(array, 2.0), total(array, 2.0)] == [3, 3, 6, 6]
    assert CALLS == [1.0, 2.0]


def test_a_writable_array_is_computed_anew_since_it_may_have_changed() -> None:
    array = np.ones(3)
    assert total(array) == 3
    array[0] = 5
    assert total(array) == 7
