"""Relative global histogram stretching: its ranges and its colour step, against the publication's formulae."""

from __future__ import annotations

import numpy as np
import pytest

from sucre_bench import Arrays, Scene, View
from sucre_bench.imaging.filters.lab import from_lab, to_lab
from sucre_bench.methods.rghs import _SPREAD, Rghs, _coloured, _equalised, _range, _top

RNG = np.random.default_rng(0)
WATER = np.float32([0.15, 0.4, 0.5]) * (0.6 + 0.8 * RNG.random((61, 47, 3), dtype=np.float32))


def restored(method: Rghs, rgb: np.ndarray) -> np.ndarray:
    view = View("photo.png", Arrays(rgb))
    return method.restore(Scene("alone", [view], frozenset()), view).image


def test_green_and_blue_are_brought_to_mid_gray_and_red_is_not():
    balanced = _equalised(WATER)
    np.testing.assert_allclose(balanced[..., 1:].mean(axis=(0, 1)), 0.5, rtol=1e-5)
    np.testing.assert_array_equal(balanced[..., 0], WATER[..., 0])


def test_the_spread_is_that_of_a_rayleigh_distribution_of_mode_one():
    assert RNG.rayleigh(1, 400_000).std() == pytest.approx(_SPREAD, rel=0.01)


def test_the_range_leaves_out_a_share_of_each_side_of_the_mode():
    """1000 values below the mode and 2000 above it: 10 % of each side are left out."""
    below, above = np.linspace(0.1, 0.3, 1000), np.linspace(0.5, 0.9, 2000)
    plane = np.concatenate([below, np.full(500, 102 / 255), above]).astype(np.float32)
    low, high, mode = _range(RNG.permutation(plane).reshape(50, 70), 10)
    assert mode == pytest.approx(102 / 255)
    assert low == pytest.approx(0.12, abs=1e-3)
    assert high == pytest.approx(0.9 - 0.4 * 250 / 2000, abs=1e-3)


@pytest.mark.parametrize("remaining", [1.1 * 0.83**3, 0.9 * 0.95**3, 0.9 * 0.97**3])
@pytest.mark.parametrize("high", [0.2, 0.6, 0.9, 1.3])
@pytest.mark.parametrize("mode", [0.0, 0.05, 0.3, 0.7])
def test_the_top_is_the_mean_over_the_whole_numbers_that_fit(remaining: float, high: float, mode: float):
    tops = [(mode + mu * 0.65514 * mode) / remaining for mu in range(-100, 100)]
    fitting = [top for top in tops if high <= top <= 1]
    expected = np.mean(fitting) if fitting and mode else 1
    assert _top(high, mode, remaining) == pytest.approx(expected, abs=1e-4)


def test_a_stretched_channel_fills_the_range_that_its_attenuation_sets():
    """Mode 0.2 in [0.1, 0.5] at 3 m: red has more to win than blue."""
    plane = np.concatenate([np.linspace(0.1, 0.5, 900), np.full(100, 51 / 255)]).astype(np.float32).reshape(25, 40)
    for channel, kept in enumerate((1.1 * 0.83**3, 0.9 * 0.95**3, 0.9 * 0.97**3)):
        tops = [(0.2 + mu * 0.65514 * 0.2) / kept for mu in range(50)]
        expected = np.mean([top for top in tops if 0.5 <= top <= 1])
        found = Rghs(tail=0)._stretched(plane, channel)
        assert found.max() == pytest.approx(expected, abs=1e-3)
        assert found.min() == pytest.approx((1 - 0.65514) * 0.2, abs=1e-3)


def test_a_stretched_channel_does_not_lift_its_blacks():
    """Mode minus sigma would be 0.17 here: a range that is wide already is not made narrower."""
    plane = np.concatenate([np.linspace(0.02, 0.9, 900), np.full(100, 0.5)]).astype(np.float32).reshape(25, 40)
    assert Rghs(tail=0)._stretched(plane, 0).min() == pytest.approx(0.02, abs=1e-6)


def test_colour_is_raised_the_more_the_weaker_it_is():
    lab = np.stack(
        [
            RNG.uniform(45, 55, (30, 30)),
            RNG.uniform(-15, 15, (30, 30)),
            RNG.uniform(-15, 15, (30, 30)),
        ],
        axis=-1,
    ).astype(np.float32)
    lab[:5, :, 0], lab[5:10, :, 0] = 0.0, 100.0
    lab[:10, :, 1:] = 0  # so that percentiles 1 and 99 are black and white, and lightness stays
    found = to_lab(_coloured(from_lab(lab)))[10:].astype(np.float64)
    before = lab[10:].astype(np.float64)
    expected = before[..., 1:] * 1.3 ** (1 - np.abs(before[..., 1:]) / 128)
    np.testing.assert_allclose(found[..., 0], before[..., 0], atol=0.5)
    np.testing.assert_allclose(found[..., 1:], expected, atol=1)  # of up to 20; OpenCV's L*a*b* is approximate


def test_lightness_keeps_its_shades():
    """Dividing 8-bit lightness by 255 in whole numbers leaves black and white only."""
    ramp = np.tile(np.linspace(0.2, 0.7, 200, dtype=np.float32)[None, :, None], (40, 1, 3))
    lightness = to_lab(restored(Rghs(), ramp))[20, :, 0]
    assert len(np.unique(np.round(lightness))) > 60
    assert (np.diff(lightness) > -0.05).all()
    assert lightness[0] < 2
    assert lightness[-1] > 98


def test_each_channel_is_a_channel_wherever_its_pixels_are():
    """All but the filter works on histograms: an image turned upside down is restored upside down."""
    order = RNG.permutation(61)
    method = Rghs(noise=0)
    np.testing.assert_array_equal(restored(method, WATER[order]), restored(method, WATER)[order])


def test_red_and_blue_are_not_taken_for_each_other():
    swapped = np.ascontiguousarray(WATER[..., ::-1])
    assert np.abs(restored(Rghs(), swapped)[..., ::-1] - restored(Rghs(), WATER)).mean() > 0.05


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
