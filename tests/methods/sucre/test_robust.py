"""Weights that leave out what does not fit, on observations with known outliers."""

from dataclasses import replace

import numpy as np
from support.made_observations import flat, made, parameters, solve_exact, table
from support.made_scene import WATER

from sucre_bench.methods.sucre.exact import WaterFit, fit
from sucre_bench.methods.sucre.robust import fit_robustly, reweighted
from sucre_bench.methods.sucre.solution import colours_for_water
from sucre_bench.multiview.observations import Observations

TRUE = parameters(WATER)
NOISE = 0.004


def spoilt(
    observations: Observations, share: float = 0.12, seed: int = 5
) -> tuple[Observations, np.ndarray]:
    """Observations of which some show one thing that is not there, and which ones."""
    wrong = np.random.default_rng(seed).random(len(observations)) < share
    colour = observations.colour.copy()
    colour[:, wrong] = (
        np.array([[0.55], [0.5], [0.35]]) if colour.dtype.kind == "f" else [[140], [128], [90]]
    )
    return replace(observations, colour=colour), wrong


def psnr(observations: Observations, found: WaterFit, J: np.ndarray, at: np.ndarray) -> float:
    mine = colours_for_water(observations, found.water, None, "numpy", "cpu").J
    return float(-10 * np.log10(((mine - J)[:, at] ** 2).mean()))


def test_water_and_colours_survive_an_animal_in_every_eighth_observation() -> None:
    clean, J = made(4000, distances_m=(1, 6), noise=NOISE, eight_bit=True)
    observations, wrong = spoilt(clean)
    plain, (robust, weighted) = fit(observations), fit_robustly(observations, fit)
    assert np.abs(table(plain.water) / table(TRUE) - 1).max() > 0.3
    assert np.abs(table(robust.water) / table(TRUE) - 1).max() < 0.08
    # a majority is right
    often = (observations.counts >= 5) & (np.bincount(flat(observations)[0], wrong) <= 1)
    assert psnr(weighted, robust, J, often) > 35 > 25 > psnr(observations, plain, J, often)


def animal(observations: Observations) -> np.ndarray:
    """What a gray animal in a corner of view 2 covers, (N,) bool."""
    assert observations.view is not None
    row, column = np.divmod(observations.pixels[flat(observations)[0]], observations.shape[1])
    return (observations.view == 2) & (row < 30) & (column < 40)


def test_a_view_of_another_place_is_named_and_one_with_an_animal_is_not() -> None:
    observations, _ = made(4800, distances_m=(1, 6), noise=NOISE, shape=(60, 80))
    for wrong, is_named in ((observations.view == 2, True), (animal(observations), False)):
        colour = observations.colour.copy()
        colour[:, wrong] = np.random.default_rng(0).permuted(colour[:, wrong], axis=1)
        limits = " ".join(
            solve_exact(replace(observations, colour=colour), robust=True).uncertainty.limits
        )
        assert (f"{observations.views[2]} shows other things" in limits) == is_named


def test_the_weight_of_two_is_that_of_their_difference() -> None:
    """s^2 is the squared difference, over its variance; at 3 noises in one channel 9."""
    observations, _ = made(1, n_views=2, distances_m=(2, 5), seed=1)
    z = observations.distance.astype(np.float64)
    a = np.exp(-TRUE.beta[0] * z)
    # of the second, from what the first foretells
    off = 3 * 0.01 * np.sqrt(1 + (a[1] / a[0]) ** 2)
    colour = observations.colour.copy()
    colour[0, 1] += off
    weight = reweighted(replace(observations, colour=colour), TRUE, np.full(3, 0.01)).weight
    np.testing.assert_allclose(weight, 1 / (1 + 9 / 30) ** 2, rtol=1e-3)


def test_earlier_weights_say_how_noisy_an_observation_is() -> None:
    """Noise 10 times larger with weight 1/100 is as expected as noise with weight 1."""
    observations, _ = made(2000, noise=10 * NOISE)
    tenth = replace(observations, weight=np.full(len(observations), 0.01, dtype=np.float32))
    expected = reweighted(observations, TRUE, np.full(3, 10 * NOISE)).weight
    np.testing.assert_allclose(
        reweighted(tenth, TRUE, np.full(3, NOISE)).weight, 0.01 * expected, rtol=1e-3, atol=1e-5
    )
