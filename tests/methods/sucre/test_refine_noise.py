"""Standard deviations of colours against the errors that made observations have; noise in red, where green is known."""

from dataclasses import replace

import numpy as np
import pytest
from support.forward_model import in_water
from support.made_observations import parameters
from support.made_scene import WATER

from sucre_bench.methods.sucre.refine_noise import calibrated, followed
from sucre_bench.methods.sucre.robust import reweighted, robust_noise
from sucre_bench.methods.sucre.solution import colours_for_water
from sucre_bench.multiview.observations import Observations, Seen, arrange

N = 20_000
WATER_OF_ALL = parameters(WATER)


def observed(sigma: float, tau: float) -> tuple[Observations, np.ndarray, np.ndarray]:
    """Observations with camera noise sigma and with colours that differ by tau between views; J (3, P); near (P,)."""
    rng = np.random.default_rng(0)
    J, seen = rng.uniform(0.1, 0.9, (3, N)), []
    near = np.arange(N) % 2 == 0
    for k in range(5):
        chosen = np.flatnonzero(rng.random(N) < 0.7) if k else np.arange(N)
        z = np.where(
            near[chosen], rng.uniform(1, 3, len(chosen)), rng.uniform(5, 9, len(chosen))
        )
        shown = J[:, chosen] + tau * rng.standard_normal((3, len(chosen)))
        I = in_water(shown.T, z, WATER)
        I += sigma * rng.standard_normal(I.shape)
        seen.append(Seen(f"{k}.png", chosen, z.astype(np.float32), I.astype(np.float32)))
    observations = arrange((1, N), seen)
    return observations, J[:, observations.pixels], near[observations.pixels]


@pytest.mark.parametrize(("sigma", "tau"), [(0.01, 0.0), (0.002, 0.05), (0.01, 0.05)])
def test_deviations_are_those_of_near_and_of_far_colours(sigma: float, tau: float) -> None:
    observations, J, near = observed(sigma, tau)
    solution = calibrated(
        observations, colours_for_water(observations, WATER_OF_ALL, None, "numpy", "cpu")
    )
    for which in (near, ~near):
        error, told = (
            np.sqrt(np.mean(v[:, which] ** 2, axis=1))
            for v in (solution.J - J, solution.deviation)
        )
        np.testing.assert_allclose(error, told, rtol=0.12)


def test_colours_that_no_light_comes_from_are_not_known() -> None:
    observations, _, _ = observed(0.01, 0.0)
    distance = observations.distance.copy()
    for n, part in observations.slots():
        # red of beta .42: exp(-126), whose square is no number in float32
        distance[part][: min(n, 300)] = 300
    gone = replace(observations, distance=distance)
    solution = calibrated(gone, colours_for_water(gone, WATER_OF_ALL, None, "numpy", "cpu"))
    assert np.isfinite(solution.deviation).all()
    assert (solution.deviation[0, :300] > 100).all()


def test_too_few_repeated_pixels_keep_the_common_deviation() -> None:
    observations, _, _ = observed(0.01, 0.05)
    few = observations.take(np.arange(100))
    solution = colours_for_water(few, WATER_OF_ALL, None, "numpy", "cpu")
    assert calibrated(few, solution) is solution


@pytest.mark.parametrize("wrong", [0.0, 0.1])
@pytest.mark.parametrize("tau", [0.0, 0.05])
def test_deviations_of_robust_colours_are_their_errors(tau: float, wrong: float) -> None:
    """Medians, since a pixel whose observations are mostly wrong has a wrong colour."""
    rng = np.random.default_rng(1)
    observations, J, near = observed(0.01, tau)
    colour, bad = observations.intensity(slice(None)), rng.random(len(observations)) < wrong
    colour[:, bad] = rng.uniform(0, 1, (3, int(bad.sum())))
    observations = replace(observations, colour=colour)
    weighted = reweighted(observations, WATER_OF_ALL, robust_noise(observations, WATER_OF_ALL))
    found = replace(
        colours_for_water(weighted, WATER_OF_ALL, None, "numpy", "cpu"), trust=weighted.weight
    )
    solution = calibrated(observations, found)
    for which in (near, ~near):
        several = which & (observations.counts >= 3)
        # of a normal error
        error = np.median(np.abs(solution.J - J)[:, several], axis=1) / 0.6745
        np.testing.assert_allclose(
            error, np.median(solution.deviation[:, several], axis=1), rtol=0.2
        )


# -- two channels follow the third ------------------------------------------------------------------------------


def test_holes_stay_and_unknown_deviations_are_no_numbers_in_colours() -> None:
    J = np.random.default_rng(0).uniform(0.2, 0.6, (90, 120, 3)).astype(np.float32)
    deviation = np.full_like(J, 0.05)
    J[:20, :20], deviation[:20, :20] = np.nan, np.nan
    deviation[50:60, :, 0] = np.inf
    after, left = followed(J, deviation)
    np.testing.assert_array_equal(np.isnan(after), np.isnan(J))
    assert np.isinf(left[50:60, :, 0]).all()
    assert np.isnan(followed(np.full_like(J, np.nan), deviation)[0]).all()
