"""Standard deviations of colours against the errors that made observations have."""

from __future__ import annotations

import numpy as np
import pytest
from support.made_observations import parameters
from support.made_scene import WATER

from sucre_bench.methods.sucre.calibrated_noise import calibrated, noise_parts
from sucre_bench.methods.sucre.solvers import colours_for_water
from sucre_bench.multiview.observations import Observations, Seen, arrange

N, WATER_OF_ALL = 20_000, parameters(WATER)


def observed(sigma: float, tau: float) -> tuple[Observations, np.ndarray, np.ndarray]:
    """Observations with camera noise sigma and with colours that differ by tau between views; J (3, P); near (P,)."""
    rng = np.random.default_rng(0)
    J, seen = rng.uniform(0.1, 0.9, (3, N)), []
    B, beta, gamma = WATER_OF_ALL.columns()
    near = np.arange(N) % 2 == 0
    for k in range(5):
        chosen = np.flatnonzero(rng.random(N) < 0.7) if k else np.arange(N)
        z = np.where(near[chosen], rng.uniform(1, 3, len(chosen)), rng.uniform(5, 9, len(chosen)))
        shown = J[:, chosen] + tau * rng.standard_normal((3, len(chosen)))
        I = shown * np.exp(-beta * z) + B * (1 - np.exp(-gamma * z))  # noqa: E741
        I += sigma * rng.standard_normal(I.shape)  # noqa: E741
        seen.append(Seen(f"{k}.png", chosen, z.astype(np.float32), I.T.astype(np.float32)))
    observations = arrange((1, N), seen)
    return observations, J[:, observations.pixels], near[observations.pixels]


@pytest.mark.parametrize(("sigma", "tau"), [(0.01, 0.0), (0.002, 0.05), (0.01, 0.05)])
def test_deviations_are_those_of_near_and_of_far_colours(sigma: float, tau: float) -> None:
    observations, J, near = observed(sigma, tau)
    solution = calibrated(observations, colours_for_water(observations, WATER_OF_ALL, None, "numpy", "cpu"))
    for which in (near, ~near):
        error, told = (np.sqrt(np.mean(v[:, which] ** 2, axis=1)) for v in (solution.J - J, solution.deviation))
        np.testing.assert_allclose(error, told, rtol=0.12)


def test_both_parts_are_found() -> None:
    observations, _, _ = observed(0.01, 0.05)
    solution = colours_for_water(observations, WATER_OF_ALL, None, "numpy", "cpu")
    sigma, tau = noise_parts(observations, solution)
    np.testing.assert_allclose(sigma, 0.01, rtol=0.2)
    np.testing.assert_allclose(tau, 0.05, rtol=0.2)


def test_too_few_repeated_pixels_keep_the_common_deviation() -> None:
    observations, _, _ = observed(0.01, 0.05)
    few = observations.take(np.arange(100))
    solution = colours_for_water(few, WATER_OF_ALL, None, "numpy", "cpu")
    assert calibrated(few, solution) is solution
