"""Sea-thru*, against waters that are known and against its definitions, computed slowly."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
from support.forward_model import CLEAR, alone, random_seabed, view_in_water

import sucre_bench as sb
from sucre_bench import Arrays, InputError, View
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.imaging.image_formation import TwoTerm
from sucre_bench.methods.seathru import (
    Seathru,
    amplified,
    at_bound,
    constant_attenuation,
    dark_pixels,
    fit_attenuation,
    fit_backscatter,
    illuminant_by_distance,
    local_average,
)


def psnr(image: np.ndarray, truth: np.ndarray) -> float:
    """Over all pixels, up to one factor a channel."""
    factor = (image * truth).sum(axis=(0, 1)) / (image * image).sum(axis=(0, 1))
    return float(-10 * np.log10(np.mean((image * factor - truth) ** 2)))


# Dark pixels


def test_dark_pixels_are_the_darkest_of_each_bin():
    rng = np.random.default_rng(1)
    z, intensity = rng.uniform(1, 11, 5000), rng.random((5000, 3))
    chosen = dark_pixels(intensity, z, bins=10, share=0.01, most=3)
    edges, grey = np.linspace(z.min(), z.max(), 11), intensity.mean(axis=1)
    expected: list[int] = []
    for a, b in itertools.pairwise(edges[1:]):
        # the first of ten bins is the nearest tenth of the range
        inside = np.flatnonzero((z > a) & (z <= b))
        expected += sorted(inside, key=lambda i: grey[i])[:3]
    assert sorted(chosen.tolist()) == sorted(expected)


def test_a_bin_gives_its_share_where_that_is_less_than_the_most():
    rng = np.random.default_rng(2)
    z = np.concatenate([rng.uniform(1, 1.999, 500), [2.0], rng.uniform(2.001, 3, 450)])
    chosen = dark_pixels(rng.random((len(z), 3)), z, bins=2, share=0.01, most=20)
    assert (z[chosen] >= 2).sum() == 5  # ceil(451 * 0.01)


# Backscatter


@pytest.mark.parametrize(("residual", "rate"), [(0.0, 0.5), (0.15, 0.4)])
def test_backscatter_is_recovered_from_dark_pixels(residual: float, rate: float):
    rng = np.random.default_rng(3)
    z = rng.uniform(2, 9, 200)
    truth = CLEAR.veiling_light * (1 - np.exp(-np.outer(z, CLEAR.backscatter)))
    noisy = truth + (residual * np.exp(-rate * z))[:, None] + rng.normal(0, 0.002, (200, 3))
    found = fit_backscatter(np.rint(noisy * 255) / 255, z)
    at = np.linspace(2, 9, 50)
    for c in range(3):
        true = CLEAR.veiling_light[c] * (1 - np.exp(-CLEAR.backscatter[c] * at))
        assert np.sqrt(np.mean((found.veil(at, c) - true) ** 2)) < 0.018


def test_a_dead_pixel_does_not_move_the_backscatter():
    z = np.linspace(2, 9, 180)
    dark = CLEAR.veiling_light * (1 - np.exp(-np.outer(z, CLEAR.backscatter)))
    dead = dark.copy()
    dead[::12] = 0
    at = np.linspace(2, 9, 50)
    for c in range(3):
        true = CLEAR.veiling_light[c] * (1 - np.exp(-CLEAR.backscatter[c] * at))
        assert np.abs(fit_backscatter(dead, z).veil(at, c) - true).max() < 0.012


def test_backscatter_does_not_depend_on_the_unit_of_distance():
    """A fall-back that compares intensities with metres would."""
    z = np.linspace(2, 9, 180)
    dark = CLEAR.veiling_light * (1 - np.exp(-np.outer(z, CLEAR.backscatter)))
    metres, double = fit_backscatter(dark, z), fit_backscatter(dark, 2 * z)
    for c in range(3):
        np.testing.assert_allclose(metres.veil(z, c), double.veil(2 * z, c), atol=0.003)


# Illuminant


def slow_average(direct: np.ndarray, z: np.ndarray, p: float, eps: float) -> np.ndarray:
    """The published repetition over 4-neighbours, in float64, pixel by pixel, until nothing moves."""
    height, width = z.shape
    tolerance = eps * (z[z > 0].max() - z[z > 0].min())
    a = direct.astype(np.float64)
    while True:
        new = a.copy()
        for y in range(height):
            for x in range(width):
                around = [(y + 1, x), (y - 1, x), (y, x + 1), (y, x - 1)]
                inside = [
                    n for n in around if 0 <= n[0] < height and 0 <= n[1] < width and z[n] > 0
                ]
                near = [a[n] for n in inside if abs(z[n] - z[y, x]) <= tolerance]
                new[y, x] = (
                    p * direct[y, x] + (1 - p) * np.mean(near, axis=0) if near else direct[y, x]
                )
        if np.abs(new - a).max() < 1e-9:
            return new
        a = new


def test_the_local_average_is_that_of_the_published_repetition():
    rng = np.random.default_rng(4)
    z = rng.uniform(2, 2.2, (9, 11)).astype(np.float32)
    z[:, 6:] += 3  # an edge that nothing crosses
    z[2, 2] = 3.6  # a pixel without neighbours
    z[4:6, 3:9] = 0
    direct = rng.random((9, 11, 3))
    expected = slow_average(direct, z, 0.05, 0.1)[z > 0]
    np.testing.assert_allclose(local_average(direct[z > 0], z, 0.05, 0.1), expected, atol=2e-5)


# Attenuation


def test_two_terms_bear_outliers():
    rng = np.random.default_rng(5)
    z = np.linspace(1, 10, 100)
    true = TwoTerm(0.6, 0.7, 0.2, 0.03)
    E = np.exp(-true(z) * z + rng.normal(0, 0.02, 100))
    E[::20] *= 0.3
    np.testing.assert_allclose(fit_attenuation(z, E, "two_term")(z), true(z), rtol=0.1)


def test_a_constant_attenuation_is_recovered():
    z = np.linspace(2, 4, 30)
    assert constant_attenuation(z, np.exp(-0.37 * z)) == pytest.approx(0.37)
    assert fit_attenuation(z, np.exp(-0.37 * z), "constant")(z) == pytest.approx(0.37)


def test_light_never_grows_with_distance_even_where_the_terms_say_so():
    """Seen from above, distances hardly differ, and 1 / z describes a constant just as well."""
    z = np.linspace(1.8, 2.2, 50)
    decaying = TwoTerm(40.0, 2.5)
    assert np.diff(decaying.optical_depth(z)).max() < 0
    assert np.diff(amplified(decaying, z, 100)).min() >= 0


def test_amplification_is_limited():
    z = np.linspace(1, 20, 50)
    assert np.exp(amplified(TwoTerm(1.0), z, 25)).max() == pytest.approx(25)


def test_the_illuminant_of_a_distance_is_a_median():
    rng = np.random.default_rng(6)
    z, E = rng.uniform(2, 7, 4000).astype(np.float32), rng.random((4000, 3))
    at, found = illuminant_by_distance(E, z)
    low, high = z.min(), z.min() + (z.max() - z.min()) / 100
    first = (z >= low) & (z < high)
    assert len(at) == 100
    np.testing.assert_allclose(found[0], np.median(E[first], axis=0))
    assert low <= at[0] <= high


# The whole


def test_a_made_seabed_comes_back():
    view = random_seabed()
    truth = view.reference
    assert truth is not None
    result = sb.restore("seathru", alone(view), view)
    assert psnr(result.image, truth) > 35 > 17 > psnr(view.rgb, truth)
    np.testing.assert_allclose(result.water.attenuation, CLEAR.attenuation, rtol=0.1)
    veil, true = (
        w.veiling_light * (1 - np.exp(-np.outer(np.linspace(2, 8, 20), w.backscatter)))
        for w in (result.water, CLEAR)
    )
    np.testing.assert_allclose(veil, true, atol=0.012)


def test_a_constant_attenuation_restores_what_it_reports():
    """SUCRe, eq. 3, with the water reported, before white balance."""
    view = random_seabed(1)
    result = sb.restore(
        "seathru",
        alone(view),
        view,
        attenuation="constant",
        white_balance="none",
        amplification=1e3,
    )
    water, z = result.water, view.depth[..., None].astype(np.float64)
    veil = water.veiling_light * (1 - np.exp(-water.backscatter * z))
    np.testing.assert_allclose(
        result.image, (view.rgb - veil) * np.exp(water.attenuation * z), atol=2e-4
    )


def test_raw_works_in_linear_light():
    """What it makes of a gamma-encoded view is what it makes of the same view in linear light."""
    linear = random_seabed(2)
    rgb = linear.rgb
    encoded = replace(linear, pixels=Arrays(srgb_encode(rgb), linear.depth))
    as_linear = sb.restore("seathru", alone(linear), replace(linear, encoding="linear"), raw=True)
    as_encoded = sb.restore("seathru", alone(encoded), encoded, raw=True)
    np.testing.assert_allclose(srgb_decode(as_encoded.image), as_linear.image, atol=2e-3)
    assert psnr(as_linear.image, linear.reference) > 30
    other = sb.restore("seathru", alone(encoded), encoded)
    assert np.abs(other.image - as_encoded.image).mean() > 0.02


def test_white_balance_equals_the_means_of_what_is_shown():
    """Of red, a few pixels are bright: beyond 1, amplified highlights must not count."""
    seabed, rng = random_seabed(3), np.random.default_rng(3)
    J = seabed.reference.copy()
    J[..., 0] = 0.05 + 0.9 * rng.random(J.shape[:2]) ** 4
    view = view_in_water(J, seabed.depth, CLEAR)
    plain, balanced = (
        sb.restore("seathru", alone(view), view, p=1.0, white_balance=how).image
        for how in ("none", "gray-world")
    )
    mean = plain.clip(0, 1).mean(axis=(0, 1), dtype=np.float64)
    assert plain.max() > 1.5
    assert np.ptp(mean) > 0.03
    np.testing.assert_allclose(balanced, plain * (mean.mean() / mean), rtol=1e-4, atol=1e-6)


def test_a_red_channel_that_is_all_but_dead_gives_no_red_cast():
    """One grey level at random is no light: neither attenuation nor white balance may make a colour of it."""
    view = random_seabed(4)
    rgb = view.rgb.copy()
    rgb[..., 0] = (np.random.default_rng(0).random(view.depth.shape) < 0.05) / 255
    dead = replace(view, pixels=Arrays(rgb, view.depth))
    result = sb.restore("seathru", alone(dead), dead)
    assert result.image[..., 0].max() < 0.2
    assert result.image[..., 0].mean() < 0.02
    assert "red" in result.info["undetermined"]


def test_one_pixel_with_depth_is_enough():
    depth = np.zeros((40, 40))
    depth[7, 9] = 2.0
    view = View("a.png", Arrays(np.random.default_rng(0).random((40, 40, 3)), depth))
    result = sb.restore("seathru", alone(view), view, size=16)
    assert np.isfinite(result.image[7, 9]).all()
    assert result.valid.sum() == 1


def test_estimating_on_fewer_pixels_hardly_changes_the_result():
    view = random_seabed(6)
    large = view_in_water(
        *(np.repeat(np.repeat(x, 2, 0), 2, 1) for x in (view.reference, view.depth)), CLEAR
    )
    one, two = (sb.restore("seathru", alone(v), v, size=160).image for v in (view, large))
    np.testing.assert_allclose(two[::2, ::2], one, atol=2e-2)


def test_a_factor_at_its_bound_is_told_apart_from_one_that_fits():
    assert at_bound(TwoTerm(0.3, 0.1, 99.99999999999417, 3.0))
    assert at_bound(TwoTerm(5.0))
    assert not at_bound(TwoTerm(5.0, 0.1, 90.0, 3.0))
    assert not at_bound(TwoTerm(0.4))


def test_an_attenuation_at_its_bound_is_named():
    """Through a hand's breadth of ink, all that is seen fades by exp(-7 z)."""
    z = np.tile(np.linspace(0.3, 0.6, 160, dtype=np.float32)[:, None], (1, 120))
    J = np.random.default_rng(0).uniform(0.3, 0.9, (160, 120, 3))
    J[::8, ::5] = 0
    view = View("a.png", Arrays(J * np.exp(-7 * z[..., None]), z))
    result = sb.restore("seathru", alone(view), view, attenuation="constant")
    assert re.search(r"beta\(z\), .*red, green, blue", result.info["undetermined"])


def test_a_water_that_does_not_fade_is_named():
    z = np.tile(np.linspace(2, 8, 160, dtype=np.float32)[:, None], (1, 120))
    J = np.random.default_rng(7).uniform(0.7, 1, (160, 120, 3))
    J[::8, ::5] = 0
    view = View("a.png", Arrays(J, z))
    result = sb.restore("seathru", alone(view), view, attenuation="constant")
    assert re.search("attenuation .*red, green, blue", result.info["undetermined"])


@pytest.mark.parametrize(
    "wrong",
    [{"f": float("inf")}, {"p": float("nan")}, {"share": 2.0}, {"bins": 0}, {"amplification": 0.5}],
)
def test_options_that_mean_nothing_are_refused(wrong: dict[str, float]):
    with pytest.raises(InputError, match=next(iter(wrong))):
        Seathru(**wrong)
