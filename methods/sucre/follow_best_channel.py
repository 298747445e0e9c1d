"""Takes noise out of two channels with the third, which is known best, around each pixel.

Water takes one channel first, mostly red, so that channel is noisy where another is still sharp. On one surface the
channels are nearly a linear function of each other. With the best-known channel g, a window of weighted least squares
gives for another channel c

    P = alpha J_g + beta,    r = the mean square of J_c - P,    m = max(r - kappa v, 0),

where v is the mean variance of the noise of J_c. So m is what g does not explain and noise does not either: things of
another colour. The colour becomes

    J_c' = P + m / (m + kappa v) (J_c - P),

the local Wiener filter (Lee 1980) around a guided filter (He et al. 2013). Where noise is small, nothing changes.
Standard deviations also contain how views differ smoothly (light, exposure). Neighbours share that, so no window shows
it. kappa, at most 1, is the share of the variance that differs from pixel to pixel: a low percentile of r / v. The
variance that is left is (1 - kappa) v + kappa v m / (m + kappa v).
"""

from __future__ import annotations

import numpy as np

from sucre_bench.arrays import Array, Mask

# Half a window, as a share of the image's width; at least so many pixels.
_HALF, _FEWEST = 0.005, 3

# Variance of things that look alike, added to the guide's and to that of weights.
_ALIKE, _FLOOR = 1e-4, 1e-3

# The percentile of r / v that is taken for noise alone, and the one of relative noise that ranks channels.
_PLAIN, _WORST = 10, 90

# Least brightness that noise is compared with, and the variance of a colour without any information.
_DARK, _ENDLESS = 0.02, 1e4

_TINY = 1e-9


def followed(J: Array, deviation: Array) -> tuple[Array, Array]:
    """Return colours and standard deviations (H, W, 3) float32 with less noise in two channels.

    J, deviation: (H, W, 3), NaN = no colour. A deviation that is not known, NaN or infinite, stays so.
    """
    known = np.asarray(np.isfinite(J).all(axis=-1))
    result, left = np.array(J, dtype=np.float32), np.array(deviation, dtype=np.float32)
    if not known.any():
        return result, left
    variance = np.where(np.isfinite(deviation), deviation, np.sqrt(_ENDLESS)).astype(np.float32) ** 2
    colours = np.where(known[..., None], J, 0).astype(np.float32)
    relative = np.sqrt(variance[known]) / np.maximum(np.abs(J[known]), _DARK)
    best = int(np.argmin(np.percentile(relative, _WORST, axis=0)))
    half = max(_FEWEST, round(_HALF * J.shape[1]))
    for c in {0, 1, 2} - {best}:
        y, v = colours[..., c], variance[..., c]
        after, share = _filtered(y, v, colours[..., best], variance[..., best], known, half)
        result[..., c] = np.where(known, after, np.nan)
        left[..., c] *= np.sqrt(share)
    return result, left


def _filtered(y: Array, v: Array, x: Array, v_x: Array, known: Mask, half: int) -> tuple[Array, Array]:
    """Return the channel y (H, W) of variance v, filtered with the guide x of variance v_x, and the share of v left."""
    weight = np.where(known, 1 / (v + np.float32(_FLOOR)), np.float32(0))
    total = _sum(weight, half) + _TINY

    def mean(values: Array) -> Array:
        return _sum(weight * values, half) / total

    x_mean, y_mean = mean(x), mean(y)
    xy, xx = mean(x * y) - x_mean * y_mean, np.maximum(mean(x * x) - x_mean**2, 0)
    alpha = xy / (xx + _ALIKE + mean(v_x))
    rest = np.maximum(mean(y * y) - y_mean**2 - 2 * alpha * xy + alpha**2 * xx, 0)
    noise = np.maximum(mean(v), _TINY)
    kappa = min(1.0, float(np.percentile((rest / noise)[known], _PLAIN)))
    own = np.maximum(mean(np.maximum(rest - kappa * noise, 0)), _TINY)  # sums of windows leave rounding errors
    plain = mean(alpha) * x + mean(y_mean - alpha * x_mean)
    kept = own / (own + kappa * v)
    return np.asarray(plain + kept * (y - plain)), np.asarray(1 - kappa + kappa * kept)


def _sum(image: Array, half: int) -> Array:
    import cv2

    size = (2 * half + 1, 2 * half + 1)
    return np.asarray(cv2.boxFilter(image, -1, size, normalize=False, borderType=cv2.BORDER_CONSTANT))
