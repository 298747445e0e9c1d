"""The least-squares problem in the water alone, after every pixel's colour is eliminated.

SUCRe's eq. 7 minimises sum r^2 with r = I - J a - b, for each channel over B, beta, gamma and one J a pixel. Given the
water, J_p = sum a (I - b) / sum a^2 over the observations of pixel p. Putting that back leaves a problem in three
unknowns a channel (variable projection, Golub & Pereyra 1973). With D = dI/d(B, beta, gamma) and the part of D that no
change of J_p can imitate, D' = D - a (sum a D) / (sum a^2), its Gauss-Newton system is

    H step = g,    H = sum D'^T D',    g = sum D'^T r,    cost = sum r^2.

The sums are over all pixels, so the systems of several images in one water add up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array


@dataclass(frozen=True, slots=True, eq=False)
class ReducedSystem:
    """The reduced problem around one water, for C channels with n = 3 parameters each: B, beta, gamma.

    H: (C, n, n) float64; g: (C, n) float64, minus half the gradient of the cost; cost: (C,) float64.
    """

    H: Array
    g: Array
    cost: Array

    def __add__(self, other: ReducedSystem) -> ReducedSystem:
        return ReducedSystem(self.H + other.H, self.g + other.g, self.cost + other.cost)

    @staticmethod
    def from_products(products: Array) -> ReducedSystem:
        """Take apart products (C, 4, 4) of the columns (D'_B, D'_beta, D'_gamma, r), summed over observations."""
        return ReducedSystem(products[:, :3, :3], products[:, :3, 3], products[:, 3, 3])

    def predicted_reduction(self, step: Array) -> Array:
        """Return by how much (C,) a step (C, n) lowers the cost of the linear model."""
        return 2 * (self.g * step).sum(axis=1) - np.einsum("ci,cij,cj->c", step, self.H, step)
