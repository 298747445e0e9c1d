"""Newton's method inside bounds, against problems whose minimum is known."""

from __future__ import annotations

import itertools

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.methods.sucre.minimise import Bounds, minimise
from sucre_bench.methods.sucre.model import ReducedSystem


def test_the_minimum_inside_bounds_is_the_best_of_all_choices_of_held_parameters() -> None:
    """Of a quadratic cost: each parameter is free or at one of its bounds, 27 choices in all."""
    rng = np.random.default_rng(0)
    lower, upper = np.zeros(3), np.ones(3)
    for _ in range(50):
        D, y = rng.normal(size=(6, 3)), rng.normal(size=6)

        def cost(x: Array, D: Array = D, y: Array = y) -> float:
            return float(((y - D @ x) ** 2).sum())

        def evaluate(rows: Array, D: Array = D, y: Array = y) -> ReducedSystem:
            r = y - D @ rows[0]
            return ReducedSystem(
                (D.T @ D)[None], (D.T @ r)[None], np.array([r @ r]), (D.T @ D)[None]
            )

        best = np.inf
        for held in itertools.product((0.0, 1.0, np.nan), repeat=3):
            x = np.array(held)
            free = np.isnan(x)
            rest = y - D[:, ~free] @ x[~free]
            x[free] = np.linalg.lstsq(D[:, free], rest, rcond=None)[0]
            if ((x >= lower) & (x <= upper)).all():
                best = min(best, cost(x))
        bounds = Bounds(lower, upper, np.zeros(3, dtype=bool))
        end = minimise(evaluate, rng.uniform(size=(1, 3)), bounds, tolerance=1e-12)
        assert end.converged.all()
        assert cost(end.at[0]) <= best * (1 + 1e-9)


def test_a_parameter_that_goes_to_its_bound_ends_on_it() -> None:
    """Just above 0, a veil leaves backscatter a slope of rounding alone."""
    rng = np.random.default_rng(0)
    bounds = Bounds(np.zeros(1), np.ones(1), np.array([True]))
    slope = rng.uniform(1, 10, size=(400, 1))

    def evaluate(rows: Array) -> ReducedSystem:
        r = -0.2 - slope * rows
        return ReducedSystem((slope**2)[:, None], slope * r, (r * r)[:, 0], (slope**2)[:, None])

    end = minimise(evaluate, rng.uniform(0.1, 0.9, size=(400, 1)), bounds, tolerance=1e-9)
    assert (end.at == 0).all()


def test_residuals_that_stay_large_take_few_steps() -> None:
    """Madsen, Nielsen & Tingleff (2004), section 3.1: steps by slopes alone lead away from the minimum, 0."""
    bounds = Bounds(np.array([-2.0]), np.array([2.0]), np.array([False]))

    def evaluate(rows: Array) -> ReducedSystem:
        x = rows[:, 0]
        r = np.stack([-1 - x, 1 - x + 5 * x * x])
        D = np.stack([np.ones_like(x), 1 - 10 * x])
        H, K = (D**2).sum(0), (D**2).sum(0) + 10 * r[1]
        return ReducedSystem(
            H[:, None, None], (D * r).sum(0)[:, None], (r**2).sum(0), K[:, None, None]
        )

    end = minimise(evaluate, np.array([[0.4], [-0.4], [-1.5]]), bounds, tolerance=1e-12)
    assert end.converged.all()
    assert end.steps < 15
    np.testing.assert_allclose(end.at[:, 0], 0, atol=1e-6)


def test_a_cost_that_is_not_convex_at_the_start_leads_to_its_minimum() -> None:
    """(1 - x^2)^2 has a maximum at 0, and minima at -1 and 1."""
    bounds = Bounds(np.array([-2.0]), np.array([2.0]), np.array([False]))

    def evaluate(rows: Array) -> ReducedSystem:
        x = rows[:, 0]
        r, D = 1 - x * x, 2 * x
        H = (D * D)[:, None, None]
        return ReducedSystem(H, (D * r)[:, None], r * r, H - (2 * r)[:, None, None])

    end = minimise(evaluate, np.array([[0.1], [-0.3], [1.9]]), bounds, tolerance=1e-12)
    assert end.converged.all()
    np.testing.assert_allclose(end.at[:, 0], [1, -1, 1], atol=1e-6)


def test_a_veil_whose_light_is_near_0_leads_to_the_rate_that_made_it() -> None:
    """B (1 - exp(-gamma z)): with B near 0, the cost has nearly no curvature by gamma."""
    z = np.linspace(0.5, 5, 40)
    bounds = Bounds(np.zeros(2), np.array([1.0, 6.0]), np.array([True, False]))

    def evaluate(rows: Array) -> ReducedSystem:
        B, gamma = rows[:, :1], rows[:, 1:]
        e = np.exp(-gamma * z)
        r = 0.3 * (1 - np.exp(-0.8 * z)) - B * (1 - e)
        D = np.stack([1 - e, B * z * e], axis=1)
        H, K = (np.einsum("cin,cjn->cij", D, D) for _ in range(2))
        both, of_gamma = (r * z * e).sum(1), -(r * B * z * z * e).sum(1)
        K[:, 0, 1] -= both
        K[:, 1, 0] -= both
        K[:, 1, 1] -= of_gamma
        return ReducedSystem(H, np.einsum("cin,cn->ci", D, r), (r * r).sum(1), K)

    starts = np.array([[1e-4, 0.1], [1e-4, 4.0], [0.9, 0.3], [0.5, 2.0]])
    end = minimise(evaluate, starts, bounds, tolerance=1e-10)
    assert end.converged.all()
    np.testing.assert_allclose(end.at, [[0.3, 0.8]] * 4, rtol=1e-3)
