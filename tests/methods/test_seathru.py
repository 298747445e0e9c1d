"""Sea-thru*, against waters that are known and against its definitions, computed slowly."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pytest
from support.forward_model import CLEAR, alone, random_seabed

import sucre_bench as sb
from sucre_bench import Arrays, InputError, View
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.methods.seathru import (
    Seathru,
    constant_attenuation,
    dark_pixels,
    fit_attenuation,
    fit_backscatter,
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


def test_a_constant_attenuation_is_recovered():
    z = np.linspace(2, 4, 30)
    assert constant_attenuation(z, np.exp(-0.37 * z)) == pytest.approx(0.37)
    assert fit_attenuation(z, np.exp(-0.37 * z), "constant")(z) == pytest.approx(0.37)


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
    as_linear = sb.restore(
        "seathru", alone(linear), replace(linear, encoding="linear"), raw=True
    )
    as_encoded = sb.restore("seathru", alone(encoded), encoded, raw=True)
    np.testing.assert_allclose(srgb_decode(as_encoded.image), as_linear.image, atol=2e-3)
    assert psnr(as_linear.image, linear.reference) > 30
    other = sb.restore("seathru", alone(encoded), encoded)
    assert np.abs(other.image - as_encoded.image).mean() > 0.02


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


@pytest.mark.parametrize(
    ("nearest", "rate", "least", "named"),
    [
        (0.3, 7, 0.3, r"beta\(z\), .*red, green, blue"),
        (2, 0, 0.7, "attenuation .*red, green, blue"),
    ],
    ids=["a hand's breadth of ink: at its bound", "no water"],
)
def test_an_attenuation_that_the_image_does_not_tell_is_named(
    nearest: float, rate: float, least: float, named: str
):
    z = np.tile(np.linspace(nearest, 4 * nearest, 160, dtype=np.float32)[:, None], (1, 120))
    J = np.random.default_rng(0).uniform(least, 1, (160, 120, 3))
    J[::8, ::5] = 0
    view = View("a.png", Arrays(J * np.exp(-rate * z[..., None]), z))
    result = sb.restore("seathru", alone(view), view, attenuation="constant")
    assert re.search(named, result.info["undetermined"])


@pytest.mark.parametrize(
    "wrong",
    [
        {"f": float("inf")},
        {"p": float("nan")},
        {"share": 2.0},
        {"bins": 0},
        {"amplification": 0.5},
    ],
)
def test_options_that_mean_nothing_are_refused(wrong: dict[str, float]):
    with pytest.raises(InputError, match=next(iter(wrong))):
        Seathru(**wrong)
