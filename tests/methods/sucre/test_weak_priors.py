"""Channels that the observations do not determine get a plausible water, and say so; others stay as they are."""

from dataclasses import replace

import numpy as np
import pytest
from support.made_observations import made, solve_exact, table

from sucre_bench import Water
from sucre_bench.methods.sucre import Sucre
from sucre_bench.methods.sucre.exact import fit
from sucre_bench.methods.sucre.record import restoration
from sucre_bench.methods.sucre.solution import colours_for_water

# A survey close above flat ground: distances hardly differ, so that B and gamma are known as a product at most.
SURVEY = {"distances_m": (1.9, 2.1), "noise": 0.01, "eight_bit": True}
CLEAR = Water(
    np.array([0.2, 0.3, 0.35]), np.array([0.3, 0.15, 0.12]), np.array([0.25, 0.15, 0.12])
)
AIR = Water(np.zeros(3), np.zeros(3), np.full(3, 0.1))


@pytest.mark.parametrize("seed", [0, 1])
def test_no_parameter_ends_at_a_bound_on_a_flat_survey(seed: int) -> None:
    observations, J = made(8_000, 5, water=CLEAR, seed=seed, **SURVEY)
    solution = solve_exact(observations)
    rows = solution.water.by_channel()
    assert (rows[:, 0] < 0.99).all()
    assert (rows[:, 1:] < 3).all()
    assert any(solution.uncertainty.is_weak)
    assert np.abs(np.median(solution.J - J, axis=1)).max() < 0.35


def test_a_veil_that_grows_ever_faster_has_no_white_light_and_leaves_beta_right() -> None:
    """As under a strobe. No B explains it, so the fit with priors would end at B = 1."""
    beta = np.array([0.3, 0.15, 0.12])
    observations, _ = made(
        6_000, 6, water=Water(np.zeros(3), beta, beta), distances_m=(2, 4), noise=0.004
    )
    veiled = observations.colour + 0.01 * observations.distance**2
    found = fit(replace(observations, colour=veiled.astype(np.float32)))
    assert ((found.water.B > 0) & (found.water.B < 0.9)).all()
    assert found.uncertainty.is_weak == (True, True, True)
    np.testing.assert_allclose(found.water.beta, beta, rtol=0.03)


def test_the_record_says_whether_a_weak_prior_decides_a_channel() -> None:
    for options, known in ((SURVEY, False), ({"noise": 0.004}, True)):
        observations, _ = made(8_000, 5, water=CLEAR, **options)
        solution = solve_exact(observations)
        found = restoration(observations, solution, {"pair": 0.0, "solve": 0.0}, Sucre())
        assert found.info["veil_known"] is known


def test_the_scale_of_the_scene_does_not_matter_to_the_priors() -> None:
    observations, _ = made(3_000, 5, water=CLEAR, **SURVEY)
    toy = replace(observations, distance=observations.distance * np.float32(1 / 32))
    np.testing.assert_allclose(
        table(fit(toy).water), table(fit(observations).water) * [[1], [32], [32]], rtol=0.02
    )


@pytest.mark.parametrize("seed", [0, 1])
def test_a_channel_without_attenuation_has_no_veil(seed: int) -> None:
    """Photographs in air whose far views are exposed a little longer, which a veil alone would explain."""
    observations, J = made(8_000, water=AIR, noise=0.004, seed=seed)
    longer = 1 + 0.005 * (observations.distance - 1)
    found = fit(replace(observations, colour=observations.intensity(slice(None)) * longer))
    assert (table(found.water) == 0).all()
    colours = colours_for_water(observations, found.water, found.uncertainty, "numpy", "cpu").J
    assert np.abs(np.median(colours - J, axis=1)).max() < 0.005


def test_clear_air_has_no_backscatter() -> None:
    observations, J = made(8_000, water=AIR, noise=0.004, eight_bit=True)
    found = fit(observations)
    assert (found.water.B == 0).all()
    assert found.water.beta.max() < 2e-3
    assert any("no veil" in limit for limit in found.uncertainty.limits)
    colours = colours_for_water(observations, found.water, found.uncertainty, "numpy", "cpu").J
    assert np.sqrt(np.mean((colours - J) ** 2)) < 0.004
