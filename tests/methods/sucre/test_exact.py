"""The exact solver, against made water, an independent minimiser and its own promises."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from support.made_ground import WATERS
from support.made_observations import made, parameters, reduced_residuals, solve_exact, table
from support.made_scene import WATER

from sucre_bench import SolveError, Water
from sucre_bench.methods.sucre.exact import fit
from sucre_bench.methods.sucre.model import ReducedSystem, WaterParameters
from sucre_bench.methods.sucre.refine_noise import prior_of
from sucre_bench.methods.sucre.solution import colours_for_water
from sucre_bench.methods.sucre.uncertainty import clustered, errors_said, uncertainty_of
from sucre_bench.multiview.observations import Observations, Seen, arrange

pytestmark = pytest.mark.short

OF_GROUNDS = [WATER, WATERS["blue ocean"], WATERS["green"]]
TRUTH = table(parameters(WATER))


# -- the minimum -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("seed", "water"), list(enumerate(OF_GROUNDS)))
def test_made_water_is_found_within_two_per_cent(seed: int, water: Water) -> None:
    observations, _ = made(60_000, water=water, noise=0.004, eight_bit=True, seed=seed)
    found = fit(observations)
    assert found.converged
    np.testing.assert_allclose(table(found.water), table(parameters(water)), rtol=0.02)


def test_no_random_start_leads_an_independent_minimiser_to_a_lower_plausible_water() -> None:
    observations, _ = made(400, 5, distances_m=(2, 6), noise=0.01, seed=3)
    found = fit(observations, backend="numpy")
    rng = np.random.default_rng(0)
    upper = np.array([1.0, 10.0, 10.0])
    for channel in range(3):
        costs = []
        for _ in range(20):
            start = rng.uniform(0, [1, 1, 2])
            end = least_squares(
                lambda water, c=channel: reduced_residuals(observations, c, water),
                start,
                bounds=(0, upper),
                xtol=1e-12,
            )
            is_plausible = end.x[2] < 5 * end.x[1]
            costs.append(2 * end.cost * (1 if is_plausible else 1.05))
        assert found.cost[channel] <= min(costs) * (1 + 1e-6)


@pytest.mark.parametrize("water", OF_GROUNDS)
def test_light_that_differs_between_views_makes_no_veil_that_is_full_at_all_distances(
    water: Water,
) -> None:
    """Such a veil is an offset of all colours, and fits nearly as well as the true water, or better."""
    observations, _ = made(20_000, 6, water=water, distances_m=(2, 4), noise=0.004, seed=3)
    rng = np.random.default_rng(3)
    for _, part in observations.slots():
        observations.colour[:, part] *= np.exp(
            0.1 * rng.normal(size=part.stop - part.start)
        ).astype(np.float32)
    np.testing.assert_allclose(fit(observations).water.gamma, water.backscatter, rtol=0.5)


def differing(jitter: float, seed: int) -> Observations:
    """Observations in ten views; the attenuation of each view's water differs by so much."""
    observations, _ = made(48 * 36, 10, noise=0.004, shape=(36, 48), seed=seed)
    more = (
        jitter
        * np.random.default_rng(seed).normal(size=(3, len(observations.views)))[
            :, observations.view
        ]
    )
    return replace(
        observations, colour=observations.colour * np.exp(-more * observations.distance)
    )


@pytest.mark.parametrize(("jitter", "is_said"), [(0.0, False), (0.01, False), (0.1, True)])
def test_colours_of_far_ground_that_may_be_wrong_are_said_with_a_share(
    jitter: float, is_said: bool
) -> None:
    observations = differing(jitter, seed=0)
    found = fit(observations)
    known = clustered(found.uncertainty, observations, found.water)
    far = float(np.quantile(observations.distance, 0.95))
    limits = " ".join(errors_said(found.water, known, far))
    assert ("colours of far ground may be wrong by" in limits) == is_said


@pytest.mark.parametrize(("jitter", "too_small"), [(0.0, False), (0.01, True)])
def test_standard_errors_hold_where_water_differs_between_views(
    jitter: float, too_small: bool
) -> None:
    """Error over standard error has an rms of 1, not as with errors of independent observations."""
    ratios = []
    for seed in range(8):
        observations = differing(jitter, seed)
        found = fit(observations)
        errors = (found.uncertainty, clustered(found.uncertainty, observations, found.water))
        wrong = found.water.beta - WATER.attenuation
        ratios.append([wrong / one.standard_error.beta for one in errors])
    independent, by_cluster = np.sqrt(np.mean(np.square(ratios), axis=(0, 2)))
    assert 0.6 < by_cluster < 1.5
    assert (independent > 3) == too_small


def test_the_sample_hardly_matters() -> None:
    observations, _ = made(50_000, noise=0.01)
    one, other = (fit(observations, seed=seed) for seed in (0, 7))
    np.testing.assert_allclose(one.cost, other.cost, rtol=1e-6)


# -- colours held above zero -------------------------------------------------------------------------------


def shaded() -> Observations:
    """A scene that the camera's carrier shades where it is near, which the free fit takes for a bright veil."""
    observations, _ = made(
        20_000,
        distances_m=(1, 8),
        colours=(0.0, 0.5),
        n_single=5_000,
        noise=0.004,
        eight_bit=True,
    )
    light = 1 - 0.6 * np.exp(-observations.distance / 1.5)
    return replace(observations, colour=np.rint(observations.colour * light).astype(np.uint8))


def test_a_physical_fit_has_far_fewer_negative_colours() -> None:
    observations = shaded()
    free = solve_exact(observations)
    held = solve_exact(observations, physical=True)
    below = [
        (-3 * np.maximum(one.deviation, 0.01) > one.J).mean(axis=1) for one in (free, held)
    ]
    assert (below[0] > 0.02).all()
    assert (below[1] < 0.2 * below[0]).all()


def test_noise_alone_puts_no_pixel_of_lost_red_below_the_limit_of_a_physical_fit() -> None:
    far = {"n_views": 6, "distances_m": (5, 40)}
    sharp, _ = made(20_000, noise=0.004, eight_bit=True, **far)
    blurred, _ = made(20_000, noise=0.001, **far)
    held = fit(blurred, physical=True, sharp=sharp)
    np.testing.assert_allclose(table(held.water)[:, 0], TRUTH[:, 0], rtol=5e-3)


def test_noise_with_heavy_tails_leaves_the_free_water_right_and_moves_the_physical_one() -> (
    None
):
    """JPEG leaves errors in dark pixels, some far larger than most. So the judge has to choose between the two."""
    dark = {"distances_m": (2, 8), "colours": (0.0, 0.3)}
    sharp, _ = made(10_000, **dark)
    errors = 0.006 * np.random.default_rng(2).standard_t(2, sharp.colour.shape)
    sharp = replace(sharp, colour=(sharp.colour + errors).astype(np.float32))
    averaged, _ = made(10_000, noise=0.001, **dark)
    free, held = (
        solve_exact(sharp, matched=averaged, physical=physical) for physical in (False, True)
    )
    np.testing.assert_allclose(table(free.water), TRUTH, rtol=0.03)
    assert np.abs(table(held.water) / TRUTH - 1).max() > 0.05


# -- what is known about it --------------------------------------------------------------------------------


def test_standard_errors_are_those_of_repeated_experiments() -> None:
    fits = [
        fit(made(1_500, 6, distances_m=(2, 8), noise=0.01, seed=seed)[0]) for seed in range(24)
    ]
    spread = np.std([table(one.water) for one in fits], axis=0, ddof=1)
    claimed = np.mean([table(one.uncertainty.standard_error) for one in fits], axis=0)
    np.testing.assert_allclose(claimed / spread, 1, atol=0.45)  # of 24 draws: 15 % each
    assert 0.8 < np.median(claimed / spread) < 1.25
    np.testing.assert_allclose(
        np.mean([one.uncertainty.noise for one in fits], axis=0), 0.01, rtol=0.03
    )


def test_the_confidence_map_is_the_spread_of_colours_about_the_truth() -> None:
    observations, J = made(20_000, noise=0.01, n_single=4_000)
    solution = solve_exact(observations)
    score = (solution.J - J) / solution.deviation
    assert score.std() == pytest.approx(1, abs=0.03)
    once = observations.counts == 1
    assert score[:, once].std() == pytest.approx(1, abs=0.06)
    assert solution.deviation[:, once].mean() > 1.5 * solution.deviation[:, ~once].mean()


def test_a_known_water_leaves_colours_only_their_own_noise() -> None:
    narrow, J = made(5_000, distances_m=(3, 3.3), noise=0.01)
    solution = colours_for_water(narrow, parameters(WATER), None, "auto", "cpu")
    assert ((solution.J - J) / solution.deviation).std() == pytest.approx(1, abs=0.03)


def test_robust_weights_do_not_make_a_fit_surer_than_it_is() -> None:
    observations, J = made(10_000, noise=0.01)
    solution = solve_exact(observations, robust=True)
    np.testing.assert_allclose(solution.uncertainty.noise, 0.01, rtol=0.05)
    # Weights of .8 and less count as less light than there was: on the safe side, by a little.
    assert 0.9 < ((solution.J - J) / solution.deviation).std() < 1.02


@pytest.mark.parametrize("backend", ["numba", "torch", "numpy"])
def test_places_that_no_light_comes_from_do_not_spoil_the_rest(backend: Any) -> None:
    """Red of beta .42 is gone at 150 m: exp(-63), whose square is no number in float32."""
    observations, J = made(2_000, noise=0.004, n_single=100)
    distance, colour = observations.distance.copy(), observations.colour.copy()
    # the first observations of a repeated and of a single pixel
    far = [
        3,
        len(observations.pixels) - 3,
    ]
    for n, part in observations.slots():
        at = [k for k in far if k < n]
        distance[part][at] = 150
        colour[:, part][:, at] = WATER.veiling_light[:, None]
    gone = replace(observations, distance=distance, colour=colour)
    solution = solve_exact(gone, backend=backend)
    assert np.isfinite(solution.cost).all()
    assert np.isfinite(solution.J).all()
    np.testing.assert_allclose(table(solution.water), table(fit(observations).water), rtol=0.03)
    prior = prior_of(solution.J, solution.deviation)
    shrunk, deviation = prior.posterior(solution.J, solution.deviation)
    assert np.isfinite(shrunk).all()
    assert np.isfinite(deviation).all()
    assert np.abs(shrunk - J).mean() < 0.1


def test_two_observations_too_many_cannot_tell_the_noise_and_it_is_said() -> None:
    observations, _ = made(3, 2, n_single=1)
    limits = fit(observations).uncertainty.limits
    assert any("noise" in limit for limit in limits)


def test_a_narrow_range_of_distances_is_called_undetermined() -> None:
    narrow, _ = made(2_000, distances_m=(3, 3.3), noise=0.004)
    wide, _ = made(2_000, distances_m=(2, 10), noise=0.004)
    unsure, sure = fit(narrow).uncertainty, fit(wide).uncertainty
    assert any(re.match("(red|green|blue): ", limit) for limit in unsure.limits)
    assert sure.limits == ()
    assert unsure.condition.max() > 100 * sure.condition.max()


@pytest.mark.parametrize("channel", [0, 2])
@pytest.mark.parametrize("level", [0, 255])
def test_a_dead_or_saturated_channel_is_left_as_it_is_and_said(
    channel: int, level: int
) -> None:
    observations, _ = made(2_000, noise=0.004, eight_bit=True)
    colour = observations.colour.copy()
    colour[channel] = level
    solution = solve_exact(replace(observations, colour=colour))
    name = ("red", "green", "blue")[channel]
    assert any(limit.startswith(f"{name}: ") for limit in solution.uncertainty.limits)
    np.testing.assert_allclose(solution.J[channel], level / 255, atol=1e-6)
    others = [c for c in range(3) if c != channel]
    np.testing.assert_allclose(table(solution.water)[:, others], TRUTH[:, others], rtol=0.1)
    assert np.isfinite(solution.J).all()


def test_equal_distances_are_an_error_that_says_what_to_do() -> None:
    rng = np.random.default_rng(0)
    pixels, z = np.arange(500), rng.uniform(1, 5, 500).astype(np.float32)
    seen = [
        Seen(f"{k}", pixels, z, rng.uniform(0.2, 0.8, (500, 3)).astype(np.float32))
        for k in range(4)
    ]
    with pytest.raises(SolveError, match=r"\bone distance\b.*; .*water=FILE"):
        fit(arrange((1, 500), seen))


# -- the steps ---------------------------------------------------------------------------------------------


def test_a_parameter_held_at_a_bound_is_said_to_be() -> None:
    system = ReducedSystem(
        np.tile(np.eye(3), (3, 1, 1)), np.zeros((3, 3)), np.full(3, 1e-6), np.zeros((3, 3, 3))
    )
    free = np.array([[True, False, True], [True] * 3, [True] * 3])
    known = uncertainty_of(WaterParameters.of_channels(np.ones((3, 3))), system, free, 1000)
    (limit,) = known.limits
    assert limit.startswith("red: attenuation ")
    assert np.isnan(known.standard_error.beta[0])
    np.testing.assert_allclose(known.condition, 1)
