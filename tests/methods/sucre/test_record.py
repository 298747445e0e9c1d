"""What a fit leaves, on observations made with noise that is known."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.made_observations import ONE_MODEL, flat, made, parameters, table
from support.made_scene import WATER, make_scene

import sucre_bench as sb
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.record import residuals
from sucre_bench.methods.sucre.solution import colours_for_water
from sucre_bench.multiview.observations import Observations

NOISE = 0.01


def best_colours(observations: Observations) -> np.ndarray:
    """J (3, P) of least squares in the true water."""
    return colours_for_water(observations, parameters(WATER), None, "numpy", "cpu").J


def left_of(observations: Observations) -> dict[str, Any]:
    return residuals(observations, best_colours(observations), parameters(WATER))


def test_the_spread_is_that_of_the_noise_however_many_observations_a_pixel_has() -> None:
    for n_views in (2, 3, 12):
        left = left_of(made(60_000 // n_views, n_views, noise=NOISE)[0])
        assert left["std"] == pytest.approx([NOISE] * 3, rel=0.03)
        assert left["robust_std"] == pytest.approx([NOISE] * 3, rel=0.03)


def test_normal_noise_makes_a_straight_normal_plot_and_no_excess() -> None:
    left = left_of(made(25_000, noise=NOISE)[0])
    z, quantiles = np.array(left["normal"]["z"]), np.array(left["normal"]["quantiles"])
    middle = np.abs(z) <= 3
    np.testing.assert_allclose(
        quantiles[:, middle], np.tile(NOISE * z[middle], (3, 1)), atol=0.12 * NOISE
    )
    assert np.abs(left["kurtosis"]).max() < 0.1
    assert np.abs(left["skew"]).max() < 0.05
    assert np.abs(left["mean"]).max() < 0.02 * NOISE


def test_outliers_make_heavy_tails_and_leave_the_robust_spread() -> None:
    observations, _ = made(25_000, noise=NOISE)
    colour = observations.colour.copy()
    wrong = np.random.default_rng(1).random(len(observations)) < 0.01
    colour[:, wrong] += 0.2
    left = left_of(replace(observations, colour=colour))
    assert min(left["kurtosis"]) > 10
    assert min(left["skew"]) > 1
    assert min(left["std"]) > 1.5 * NOISE
    assert max(left["robust_std"]) < 1.3 * NOISE


def test_where_no_pixel_is_seen_twice_nothing_is_looked_at() -> None:
    observations, J = made(100, 1)
    assert residuals(observations, J, parameters(WATER)) == {"observations": 0}


def test_the_running_median_finds_a_bend_that_the_spread_does_not() -> None:
    observations, J = made(25_000, noise=1e-3)
    bent = observations.colour + np.where(observations.colour > 0.45, 0.02, 0).astype(
        np.float32
    )
    left = residuals(replace(observations, colour=bent), J, parameters(WATER))["against_fit"][
        "green"
    ]
    fits = np.linspace(*left["fit"], 33)[:-1]
    median = np.array(left["median"], dtype=float)
    assert np.nanmax(np.abs(median[fits < 0.42])) < 2e-3
    assert np.nanmin(median[fits > 0.46]) > 0.015


def test_points_over_distance_are_the_observations_of_their_pixel() -> None:
    observations, _ = made(4_000, noise=NOISE, eight_bit=True)
    left = left_of(observations)
    place, z, I = flat(observations)
    assert 20 <= len(left["tracks"]) <= 30
    for track in left["tracks"]:
        # the target is one row
        own = np.flatnonzero(observations.pixels[place] == track["pixel"][0])
        own = own[np.argsort(z[own])]
        np.testing.assert_allclose(track["distance"], z[own], rtol=1e-4)
        np.testing.assert_allclose(track["intensity"], I[:, own], rtol=1e-4)
        assert max(track["distance"]) > 3 * min(track["distance"])


def test_a_dead_channel_is_told_without_a_warning_and_fits_json() -> None:
    observations, _ = made(1_000, noise=NOISE)
    colour = observations.colour.copy()
    colour[0] = 0
    J = best_colours(observations)
    J[0] = 0
    water = table(parameters(WATER))
    water[:, 0] = 0
    left = residuals(replace(observations, colour=colour), J, WaterParameters(*water))
    assert left["std"][0] == 0
    assert left["kurtosis"][0] is None
    json.dumps(left, allow_nan=False)


@pytest.mark.parametrize(
    ("method", "fast"), [("sucre", ONE_MODEL), ("sucre_paper", {"steps": 5})]
)
def test_methods_record_residuals(method: str, fast: dict[str, Any]) -> None:
    scene = make_scene()
    info = sb.restore(method, scene, scene["a.png"], **fast).info
    assert info["residuals"]["observations"] > 1_000
    assert set(info["stage_seconds"]) == {"read", "pair", "solve"}


def test_residuals_are_those_of_the_fit_not_of_the_refined_colours() -> None:
    scene = make_scene()
    told = []
    for refine in (False, True):
        told.append(
            sb.restore("sucre", scene, scene["a.png"], refine=refine, **ONE_MODEL).info[
                "residuals"
            ]
        )
    assert told[0] == told[1]
