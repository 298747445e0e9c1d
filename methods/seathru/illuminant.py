"""The local illuminant: local space average colour (Ebner 2013; Akkaynak & Treibitz 2019, sec. 4.4, eqs. 12-14).

A pixel's average a takes a share p of its own colour and the rest from its neighbours, a = p D + (1 - p) mean(a of the
4-neighbours about as far from the camera). The equation is linear and has one solution. Chebyshev's semi-iteration
(Golub & Varga 1961) reaches it in some 80 rounds where plain repetition takes a thousand (p = 0.01), so that
the result does not depend on where one starts or stops.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sucre_bench.arrays import Array, Mask

if TYPE_CHECKING:
    from scipy.sparse import csr_array

_ROUNDS = 100
_CONVERGED = 1e-5


def local_average(direct: Array, z: Array, p: float, eps: float) -> Array:
    """Return the local space average colour (P, 3) float32 of the P pixels with z > 0, in reading order.

    direct: (P, 3), the image without backscatter at those pixels; z: (H, W) metres, 0 = unknown; p: share of the
    pixel's own colour, (0, 1]; eps: neighbours are no farther from each other than this share of the range of z.
    A pixel with no such neighbour keeps its colour.
    """
    mean = _neighbour_mean(z, eps)
    here, rest = (p * direct).astype(np.float32), np.float32(1 - p)
    before: Array = direct.astype(np.float32)
    average: Array = here + rest * (mean @ before)
    omega = 2.0
    for _ in range(_ROUNDS):
        omega = 1 / (1 - (1 - p) ** 2 * omega / 4)
        before, average = average, before + np.float32(omega) * (here + rest * (mean @ average) - before)
        if np.abs(average - before).max() < _CONVERGED:
            break
    return average


def _neighbour_mean(z: Array, eps: float) -> csr_array:
    """The (P, P) matrix that averages over each pixel's neighbours; a pixel without any is its own."""
    from scipy.sparse import coo_array

    known: Mask = z > 0
    number = np.cumsum(known, dtype=np.int32).reshape(z.shape) - 1
    tolerance = eps * (z[known].max() - z[known].min())
    pairs = []
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        near = known[a] & known[b] & (np.abs(z[a] - z[b]) <= tolerance)
        pairs.append(np.stack([number[a][near], number[b][near]]))
    ends = np.concatenate(pairs, axis=1)
    n = int(known.sum())
    lonely = np.flatnonzero(np.bincount(ends.ravel(), minlength=n) == 0).astype(np.int32)
    row, column = np.concatenate([ends, ends[::-1], np.stack([lonely, lonely])], axis=1)
    weight = (1 / np.bincount(row, minlength=n)).astype(np.float32)
    return coo_array((weight[row], (row, column)), shape=(n, n)).tocsr()
