"""Starting points of the fit: the best of a grid of attenuations and backscatters, each with its best veiling light.

B enters linearly, and neither its column D'_B nor the elimination of colours depends on it. So for given rates the
system at B = 0 holds the whole parabola cost(B) = cost - 2 g_B B + H_BB B^2, and one pass gives its minimum. The grid
is in units of the observed distances, since scenes may have any scale.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.methods.sucre.levenberg import Bounds
from sucre_bench.methods.sucre.model import ReducedSystem

# Attenuation and backscatter over the typical distance: a twentieth of the light lost, to nearly all.
_GRID = (0.05, 0.2, 0.7, 2.0, 6.0)

# Largest optical depth over the typical distance: exp(-30) of the light is none.
_MOST = 30.0


def bounds_for(distance_m: float) -> Bounds:
    """Return the range of B, beta, gamma: intensities, and rates for scenes seen from about this distance."""
    most = _MOST / distance_m
    return Bounds(np.zeros(3), np.array([1.0, most, most]), np.array([False, True, True]))


def promising(
    evaluate: Callable[[Array], ReducedSystem], distance_m: float, bounds: Bounds, *, keep: int
) -> list[Array]:
    """Return the `keep` best waters of the grid, best first, for each channel by itself.

    evaluate: B, beta, gamma of each channel (3, 3) -> the system there. Returns arrays (3 channels, 3).
    """
    waters, costs = [], []
    for beta, gamma in itertools.product(_GRID, _GRID):
        water = np.tile([0.0, beta / distance_m, gamma / distance_m], (3, 1))
        at_zero = evaluate(water)
        slope, curve = at_zero.g[:, 0], at_zero.H[:, 0, 0]
        B = np.divide(slope, curve, out=np.zeros(3), where=curve > 0).clip(bounds.lower[0], bounds.upper[0])
        water[:, 0] = B
        waters.append(water)
        costs.append(at_zero.cost - 2 * slope * B + curve * B**2)
    order = np.argsort(costs, axis=0, kind="stable")  # (grid, 3)
    return [np.stack([waters[order[k, c]][c] for c in range(3)]) for k in range(keep)]
