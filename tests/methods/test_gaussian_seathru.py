"""Gaussian Sea-thru, against data drawn from the very model, and its likelihood against scipy's normal distribution."""

import re
from dataclasses import replace

import numpy as np
import pytest
import scipy
from support.forward_model import alone, view_in_water
from support.made_scene import WATER

import sucre_bench as sb
from sucre_bench import Arrays, InputError, View
from sucre_bench.imaging.image_formation import ChannelWater, TwoTerm
from sucre_bench.methods.gaussian_seathru import GaussianSeathru, negative_log_likelihood


def drawn_view(seed: int = 0, height: int = 160, width: int = 120) -> View:
    """Colours drawn from N(0.5, 0.15) at distances from 1 to 9 m, in known water."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(1, 9, (height, width)).astype(np.float32)
    J = rng.normal(0.5, 0.15, (height, width, 3))
    return view_in_water(J, z, WATER)


@pytest.mark.parametrize(
    ("B", "gamma", "beta"),
    [
        (0.3, 0.2, TwoTerm(0.4)),
        (0.1, 1.0, TwoTerm(0.05)),
        (0.3, 0.2, TwoTerm(0.5, 0.6, 0.2, 0.05)),
    ],
)
def test_the_likelihood_is_that_of_a_normal_distribution(B: float, gamma: float, beta: TwoTerm):
    rng = np.random.default_rng(1)
    z, intensity = rng.uniform(1, 9, 500), rng.random(500)
    fading = np.exp(-(beta.a * np.exp(-beta.b * z) + beta.c * np.exp(-beta.d * z)) * z)
    veil = B * (1 - np.exp(-gamma * z))
    J = (intensity - veil) / fading
    expected = -scipy.stats.norm.logpdf(
        intensity, J.mean() * fading + veil, J.std() * fading
    ).mean()
    assert negative_log_likelihood(ChannelWater(B, gamma, beta), intensity, z) == pytest.approx(
        expected, rel=1e-10
    )


def test_a_simplex_that_does_not_come_to_rest_is_named():
    view = drawn_view(1, 40, 30)
    assert (
        "unfinished"
        not in sb.restore("gaussian_seathru", alone(view), view).info["undetermined"]
    )
    told = sb.restore("gaussian_seathru", alone(view), view, most_evaluations=30).info[
        "undetermined"
    ]
    assert re.search("simplex, .*red, green, blue", told)


def test_the_water_of_drawn_data_is_recovered():
    view = drawn_view(height=400, width=300)
    result = sb.restore("gaussian_seathru", alone(view), view, sample=120_000)
    np.testing.assert_allclose(result.water.attenuation, WATER.attenuation, rtol=0.03)
    z = np.linspace(1, 9, 30)[:, None]
    veil, true = (
        w.veiling_light * (1 - np.exp(-w.backscatter * z)) for w in (result.water, WATER)
    )
    np.testing.assert_allclose(veil, true, atol=0.02)
    np.testing.assert_allclose(result.info["mu"], 0.5, atol=0.03)
    np.testing.assert_allclose(result.info["sigma"], 0.15, atol=0.01)
    assert (
        np.sqrt(np.mean((result.image - view.reference) ** 2))
        < 0.05
        < np.sqrt(np.mean((view.rgb - view.reference) ** 2))
    )


def test_the_sample_is_drawn_with_the_seed_alone():
    view = drawn_view(6)
    first, again, other = (
        sb.restore("gaussian_seathru", alone(view), view, sample=5000, seed=seed).image
        for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0
    assert np.abs(first - other).mean() < 0.1


def test_a_constant_channel_is_left_as_it_is():
    view = drawn_view(8)
    rgb = view.rgb.copy()
    rgb[..., 0] = 0.3
    dead = replace(view, pixels=Arrays(rgb, view.depth))
    result = sb.restore("gaussian_seathru", alone(dead), dead)
    np.testing.assert_allclose(result.image[..., 0], 0.3, atol=1e-4)


@pytest.mark.parametrize("wrong", [{"sample": 1}, {"seed": -1}])
def test_options_that_mean_nothing_are_refused(wrong: dict[str, int]):
    with pytest.raises(InputError, match=f"method.{next(iter(wrong))}: "):
        GaussianSeathru(**wrong)
