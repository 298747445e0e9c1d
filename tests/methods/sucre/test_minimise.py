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
