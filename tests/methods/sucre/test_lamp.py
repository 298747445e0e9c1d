"""A lamp of known place and lobe, in known water, on observations made without images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.made_observations import parameters, reduced_residuals, table
from support.made_scene import WATER

from sucre_bench import SolveError
from sucre_bench.methods.sucre.exact import fit
from sucre_bench.methods.sucre.lamp import Lamp, PointsByPixel, estimate, lit, reduced_system, residuals, starting_point
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.passes import opened
from sucre_bench.multiview.observations import Observations, Seen, arrange

WATER_ROWS = np.stack([WATER.veiling_light, WATER.attenuation / 2, WATER.backscatter / 2], axis=1)
START = parameters(WATER)
HALVED = WaterParameters.of_channels(WATER_ROWS)  # rates over the light's whole way
COVARIANCE = np.array([[0.26, 0.02], [0.02, 0.18]])


def true_lamp() -> Lamp:
    """0.15 m right of the camera and 0.25 m below, turned by a few degrees about y and x."""
    (cy, sy), (cp, sp) = ((np.cos(a), np.sin(a)) for a in (0.04, 0.06))
    pose = np.eye(4)
    pose[:3, :3] = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]]) @ np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]])
    pose[:3, 3] = -pose[:3, :3] @ (0.15, 0.25, 0)
    return Lamp(pose, np.linalg.inv(COVARIANCE))


def made_lit(
    n_pixels: int, lamp: Lamp | None = None, *, n_views: int = 8, noise: float = 0.0, seed: int = 0
) -> tuple[Observations, np.ndarray]:
    """Observations in a lamp's light (None: even light, one way) and the true J (3, P); rays all over 70 degrees."""
    rng = np.random.default_rng(seed)
    J = rng.uniform(0.1, 0.9, (3, n_pixels))
    B, beta, gamma = (HALVED if lamp else START).columns()
    seen = []
    for k in range(n_views):
        chosen = np.flatnonzero(rng.random(n_pixels) < (1.0 if k < 2 else 0.7))
        ray = rng.uniform(-0.7, 0.7, (2, len(chosen))).astype(np.float32)
        z = rng.uniform(1.5, 8, len(chosen)).astype(np.float32)
        X = np.concatenate([ray, np.ones_like(ray[:1])]).astype(np.float64)
        X *= z / np.linalg.norm(X, axis=0)
        light, way = np.ones(len(z)), z.astype(np.float64)
        if lamp is not None:  # written out again, not asked of the lamp
            Y = lamp.lamp_from_cam[:3, :3] @ X + lamp.lamp_from_cam[:3, 3:]
            p = Y[:2] / Y[2]
            light = np.exp(-0.5 * np.einsum("in,ij,jn->n", p, np.linalg.inv(COVARIANCE), p))
            way = z + np.linalg.norm(Y, axis=0)
        I = light * (J[:, chosen] * np.exp(-beta * way) + B * (1 - np.exp(-gamma * way)))  # noqa: E741
        I = (I + noise * rng.standard_normal(I.shape)).clip(0, 0.99)  # noqa: E741
        seen.append(Seen(f"{k}.png", chosen, z, I.T.astype(np.float32), ray))
    observations = arrange((1, n_pixels), seen)
    return observations, J[:, observations.pixels]


def test_lamp_and_water_are_recovered_without_noise() -> None:
    found = estimate(made_lit(1500, true_lamp())[0], START)
    np.testing.assert_allclose(found.lamp.lamp_from_cam, true_lamp().lamp_from_cam, atol=2e-3)
    np.testing.assert_allclose(found.lamp.precision, true_lamp().precision, rtol=5e-3, atol=5e-3)
    np.testing.assert_allclose(found.water.by_channel(), WATER_ROWS, rtol=1e-2)
    assert found.is_worth_it


def test_lamp_and_water_are_recovered_from_noise() -> None:
    found = estimate(made_lit(4000, true_lamp(), noise=0.004)[0], START)
    np.testing.assert_allclose(found.lamp.lamp_from_cam, true_lamp().lamp_from_cam, atol=0.03)
    np.testing.assert_allclose(found.lamp.precision, true_lamp().precision, rtol=0.05, atol=0.1)
    np.testing.assert_allclose(found.water.by_channel(), WATER_ROWS, rtol=0.15)
    assert found.noise == pytest.approx(0.004, rel=0.1)


def test_even_light_needs_no_lamp() -> None:
    found = estimate(made_lit(1500, None, noise=0.004)[0], START)
    assert not found.is_worth_it
    corner = np.array([0.7, 0.7])
    assert corner @ found.lamp.precision @ corner < 0.1  # less than 5 % darker in the corners
    np.testing.assert_allclose(found.water.beta, START.beta / 2, rtol=0.2)  # twice the way


def test_gradient_and_cost_are_those_of_finite_differences() -> None:
    sample = PointsByPixel.of(made_lit(60, true_lamp(), noise=0.01)[0], 40, np.random.default_rng(0))
    at = starting_point((0.1, -0.2, 0.05), 1.5, WaterParameters.of_channels(WATER_ROWS * 1.2))
    at[[0, 1, 6]] = 0.1, -0.05, 0.3
    system, numeric = reduced_system(sample, at), np.empty(17)
    for k in range(17):
        step = np.zeros(17)
        step[k] = 1e-6
        costs = [reduced_system(sample, at + sign * step).cost[0] for sign in (1, -1)]
        numeric[k] = (costs[0] - costs[1]) / 2e-6
    np.testing.assert_allclose(-2 * system.g[0], numeric, rtol=1e-4, atol=1e-7)
    assert (np.linalg.eigvalsh(system.H[0]) > 0).all()


def test_lit_observations_have_the_lamps_own_least_squares() -> None:
    """The cost of I / l with weight l^2 is that of I with l (J a + b), and its colours are the true ones."""
    observations, J = made_lit(400, true_lamp(), noise=0.004)
    even = lit(observations, true_lamp())
    kept = replace(observations, weight=(even.weight > 0).astype(np.float32))
    sample = PointsByPixel.of(kept, 400, np.random.default_rng(0))
    unknowns = np.concatenate([starting_point((0.15, 0.25, 0), 1, HALVED)[:8], WATER_ROWS.ravel()])
    unknowns[[0, 1]] = 0.04, 0.06
    M = np.linalg.cholesky(true_lamp().precision).T
    unknowns[5:8] = M[0, 0], M[0, 1], M[1, 1]
    with opened(even, "numpy", "cpu") as kernel:
        cost = kernel.system(HALVED).cost
        mine, _ = kernel.colours(HALVED, np.full(3, 0.01), np.zeros((3, 3, 3)))
    np.testing.assert_allclose(cost, (residuals(sample, unknowns) ** 2).sum(axis=1), rtol=1e-4)
    assert np.median(np.abs(mine - J)) < 0.01


def test_lit_without_noise_is_even_light() -> None:
    observations, _ = made_lit(300, true_lamp())
    even = lit(observations, true_lamp())
    assert even.colour.dtype == np.float32
    bright = even.take(np.arange(len(even.pixels)))
    usable = bright.weight > 0
    for c in range(3):
        residuals = reduced_residuals(observations, c, WATER_ROWS[c])
        assert np.abs(residuals).max() > 0.05  # before
        place = np.concatenate([np.arange(n) for n, _ in bright.slots()])
        B, beta, gamma = WATER_ROWS[c]
        J = (bright.colour[c] - B * (1 - np.exp(-gamma * bright.distance))) * np.exp(beta * bright.distance)
        spread = np.zeros(len(bright.pixels))
        np.maximum.at(spread, place[usable], J[usable])
        np.testing.assert_allclose(J[usable], spread[place[usable]], atol=2e-3)


def test_dark_and_cut_off_observations_have_no_weight_and_earlier_weights_count() -> None:
    observations, _ = made_lit(200, true_lamp())
    colour = observations.colour.copy()
    colour[1, 3], colour[2, 5] = 0, 1
    narrow = Lamp(np.eye(4), np.eye(2) * 20)
    even = lit(replace(observations, colour=colour, weight=np.full(len(colour.T), 0.5, np.float32)), narrow)
    x, y = even.ray.astype(np.float64)
    light = np.exp(-10 * (x * x + y * y))
    clear = (np.abs(light - 0.05) > 1e-3) & (even.colour > 0.01).all(axis=0) & (even.weight > 0)
    np.testing.assert_allclose(even.weight[clear], 0.5 * light[clear] ** 2, rtol=1e-4)
    assert (even.weight[light < 0.049] == 0).all()
    assert (lit(replace(observations, colour=colour), true_lamp()).weight[[3, 5]] == 0).all()
    assert np.isfinite(even.colour).all()


def test_pixels_in_the_dark_are_left_out_and_nothing_becomes_nan() -> None:
    observations, _ = made_lit(500, true_lamp())
    even = lit(observations, Lamp(np.eye(4), np.eye(2) * 200))
    assert 0 < len(even.pixels) < 500
    with opened(even, "numpy", "cpu") as kernel:
        J, deviation = kernel.colours(HALVED, np.full(3, 0.01), np.zeros((3, 3, 3)))
        assert np.isfinite(kernel.system(HALVED).H).all()
    assert np.isfinite(J).all()
    assert np.isfinite(deviation).all()


def test_points_behind_the_lamp_are_dark() -> None:
    pose = np.eye(4)
    pose[2, 3] = -2.0
    light, way = Lamp(pose, np.eye(2)).light(np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 3.0]]))
    assert light.tolist() == [0, 1]
    assert way.tolist() == [1, 1]


def test_observations_without_rays_are_refused() -> None:
    with pytest.raises(SolveError, match="lamp"):
        estimate(replace(made_lit(50, true_lamp())[0], ray=None), START)


def test_a_pixel_whose_first_observation_lies_in_the_dark_is_held_above_zero_by_its_next() -> None:
    observations, _ = made_lit(3000, true_lamp(), noise=0.004)
    even = lit(observations, true_lamp())
    weight = even.weight.copy()
    weight[:50] = 0  # of the first slot
    even = replace(even, weight=weight)
    held = fit(even, physical=True, sharp=[even])
    np.testing.assert_allclose(table(held.water), table(HALVED), rtol=0.15)
