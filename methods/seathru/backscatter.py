"""Backscatter from the darkest pixels of each range of distances (Akkaynak & Treibitz 2019, sec. 4.3, eq. 10).

What reaches the camera from the darkest pixels is backscatter, and what little light they still reflect:
I = Binf (1 - exp(-b z)) + J' exp(-b' z). Only the first term is the water's: the second is fitted so that it does not
end up in the first, and stays in the image.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array

# Starts of the two rates, 1/m, for each pair of which the two factors follow linearly; as many as are worth refining.
_RATES = (0.05, 0.2, 0.8, 3.0)
_REFINED = 3
_GREATEST_RATE = 5.0
# Residuals beyond two grey levels count linearly only: among the darkest pixels are noise and dead ones.
_OUTLIER = 2 / 255
# Weight of (J' exp(-b' z))^2. A residual that hardly decays is a constant, and so is a veil that is nearly full: 8 bits
# cannot tell them apart, and what they leave open is given to the veil. Over five views of each of three made waters,
# the veil's error is 0.024 rms without it, 0.015 with any weight from 0.0003 to 0.03; true residuals of 0.05 to 0.15
# are told apart best with the smaller ones.
_DARKNESS = 0.001


@dataclass(frozen=True, slots=True)
class Backscatter:
    """The fitted curves: veiling_light Binf, rate b (1/m), residual J', residual_rate b' (1/m), each (3,)."""

    veiling_light: Array
    rate: Array
    residual: Array
    residual_rate: Array

    def veil(self, z: Array, channel: int) -> Array:
        """Return the water's own light at distances z (P,), without the residual."""
        return np.asarray(self.veiling_light[channel] * -np.expm1(-self.rate[channel] * z))


def dark_pixels(intensity: Array, z: Array, bins: int, share: float, most: int) -> np.ndarray:
    """Return the indices of the darkest pixels of every bin of distances, by the mean of their channels.

    intensity: (P, 3); z: (P,) metres; bins: of equal width, from the nearest to the farthest pixel; share: of a bin's
    pixels, at least one; most: of them. Pixels in the nearest tenth of the range are left out where there are others:
    there is least backscatter and most residual.
    """
    near, far = float(z.min()), float(z.max())
    bin_of = np.minimum(((z - near) * (bins / max(far - near, 1e-6))).astype(np.int64), bins - 1)
    order = np.lexsort((intensity.mean(axis=-1), bin_of))
    ends = np.searchsorted(bin_of[order], np.arange(bins + 1))
    darkest = [order[a : a + min(int(np.ceil(share * (b - a))), most)] for a, b in itertools.pairwise(ends)]
    chosen = np.concatenate(darkest)
    beyond = chosen[z[chosen] > near + 0.1 * (far - near)]
    return beyond if beyond.size else chosen


def fit_backscatter(intensity: Array, z: Array) -> Backscatter:
    """Fit eq. 10 to dark pixels (P, 3) at distances (P,) by robust least squares, each channel for itself.

    Bounds: Binf and J' in [0, 1], b and b' in [0, 5] 1/m. Starts are a grid: equal inputs give equal curves.
    """
    z = z.astype(np.float64)
    return Backscatter(*np.transpose([_fitted(intensity[:, c].astype(np.float64), z) for c in range(3)]))


def _fitted(dark: Array, z: Array) -> tuple[float, float, float, float]:
    """Return Binf, b, J', b' of one channel: the best of the most promising starts."""
    from scipy.optimize import least_squares, nnls

    def terms(b: float, rest: float) -> tuple[Array, Array]:
        return -np.expm1(-b * z), np.exp(-rest * z)

    def residuals(x: Array) -> Array:
        veil, rest = terms(x[1], x[3])
        return np.concatenate([x[0] * veil + x[2] * rest - dark, np.sqrt(_DARKNESS) * x[2] * rest])

    starts = []
    for b, rest in itertools.product(_RATES, _RATES):
        veil, faded = terms(b, rest)
        system = np.stack([np.append(veil, 0 * z), np.append(faded, np.sqrt(_DARKNESS) * faded)], axis=1)
        (B, J), misfit = nnls(system, np.append(dark, 0 * z))
        starts.append((misfit, (min(B, 1.0), b, min(J, 1.0), rest)))
    bounds = ([0, 0, 0, 0], [1, _GREATEST_RATE, 1, _GREATEST_RATE])
    fits = [
        least_squares(residuals, start, bounds=bounds, loss="soft_l1", f_scale=_OUTLIER)
        for _, start in sorted(starts)[:_REFINED]
    ]
    best = min(fits, key=lambda fit: fit.cost).x
    return float(best[0]), float(best[1]), float(best[2]), float(best[3])
