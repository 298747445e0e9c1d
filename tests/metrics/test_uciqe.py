"""uciqe: values of public programs on public pictures, hand-made pictures, and what a hole may not do."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from sucre_bench.arrays import Array
from sucre_bench.metrics.uciqe import Uciqe, uciqe
from sucre_bench.scene import Arrays, Restoration, Score, View

VARIANTS = tuple(Uciqe.__plugin__.variants)


def score(shown: Array, variant: str = "yang2015") -> Score:
    (found,) = Uciqe().score(Restoration(shown), shown, View("a.png", Arrays(shown)), variant)
    return found


def picture(name: str) -> npt.NDArray[np.uint8]:
    from skimage import data

    return np.asarray(getattr(data, name)())


@pytest.mark.parametrize(
    ("variant", "astronaut", "coffee", "digit"),
    [("yang2015", 0.688, 0.663, 0.001), ("ratio", 2.12, 1.41, 0.01), ("cielab", 38.4, 35.5, 0.1)],
)
def test_public_programs_give_these_values(variant: str, astronaut: float, coffee: float, digit: float) -> None:
    for name, value in [("astronaut", astronaut), ("coffee", coffee)]:
        found = score(np.float32(picture(name)) / np.float32(255), variant)
        assert found.value == pytest.approx(value, abs=digit / 2)
        assert found.coverage == 1


def test_the_default_is_the_form_whose_values_lie_in_0_to_1() -> None:
    assert Uciqe.__plugin__.default == ("yang2015",)


# 8-bit Lab of gray 119 is L = 128 (50.03 in CIE), a = b = 128: c = 128 sqrt(2) with the offset kept, 0 without.
C, L = 128 * 2**0.5, 128.0
BY_HAND = {
    "yang2015": 0.2576 * C / np.hypot(C, L),
    "range-contrast": 0.2576 * C / np.hypot(C, L),
    "ratio": 0.2576 * C / L,
    "cielab": 0.0,
    "hsv": 0.0,
    "strided": 0.0,
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_gray_picture_has_only_the_saturation_of_the_kept_offset(variant: str) -> None:
    gray = np.full((20, 30, 3), 119 / 255, np.float32)
    assert score(gray, variant).value == pytest.approx(BY_HAND[variant], abs=1e-4)


def test_black_and_white_by_hand() -> None:
    pixels = np.zeros((100, 3), np.uint8)
    pixels[:50] = 255  # Lab, 8 bit: (255, 128, 128) and (0, 128, 128)
    c = 128 * 2**0.5 / 255
    saturation = (c / np.hypot(c, 1) + 1) / 2
    assert uciqe(pixels, "yang2015") == pytest.approx(0.2745 + 0.2576 * saturation)
    assert uciqe(pixels, "ratio") == pytest.approx(0.2745 + 0.2576 * c / 2)  # black is without saturation
    assert uciqe(pixels, "cielab") == pytest.approx(0.2745 * 100, abs=5e-3)
    assert uciqe(pixels, "hsv") == pytest.approx(0.2745 * 100, abs=5e-3)
    assert uciqe(pixels, "strided") == pytest.approx(0, abs=0.02), "the copied slip hides the contrast"


def test_range_contrast_does_not_see_that_a_picture_is_dull_and_the_default_does() -> None:
    ramp = np.arange(256)[:, None] * np.ones(3)
    full, dull = ramp.astype(np.uint8), (100 + ramp / 8).astype(np.uint8)
    assert uciqe(full) - uciqe(dull) > 0.2
    saturation = [uciqe(p, "range-contrast") - 0.2745 * 0.98 for p in (full, dull)]
    assert np.ptp(saturation) < 0.05


def test_hsv_by_hand() -> None:
    pixels = np.array([[255, 0, 0], [255, 0, 0]], np.uint8)  # one colour: no spread, no contrast, saturation 1
    assert uciqe(pixels, "hsv") == pytest.approx(0.2576)


@pytest.mark.parametrize("variant", VARIANTS)
def test_holes_are_left_out_of_every_term(variant: str) -> None:
    rng = np.random.default_rng(4)
    shown = rng.random((40, 50, 3)).astype(np.float32)
    given = rng.random((40, 50)) < 0.6
    holed = np.where(given[..., None], shown, np.float32(np.nan))
    found = score(holed, variant)
    alone = shown[given][None]
    assert found.value == pytest.approx(score(alone, variant).value)
    assert (found.n_pixels, found.coverage) == (given.sum(), pytest.approx(given.mean()))
    assert found.value != pytest.approx(score(np.nan_to_num(holed), variant).value, abs=1e-3)


def test_a_picture_of_holes_is_nan_with_coverage_0() -> None:
    found = score(np.full((4, 4, 3), np.nan, np.float32))
    assert np.isnan(found.value)
    assert (found.n_pixels, found.coverage) == (0, 0)
