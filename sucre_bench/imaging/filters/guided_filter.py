"""Guided filter (He, Sun & Tang 2013, Guided image filtering): smooths a plane, and keeps the edges of a guide."""

import numpy as np

from sucre_bench.arrays import Array


def guided_filter(guide: Array, plane: Array, radius: int, eps: float, *, rows: int = 512) -> Array:
    """Return a plane (H, W) float32 that is, in each window, the linear function of the guide nearest to `plane`.

    guide: (H, W) or (H, W, 3), [0, 1]; radius: of the square window, pixels; eps: variance of the guide below which it
    counts as flat (eqs. 5 and 6, in colour 14 and 15). Windows are cut at the image's border. rows: filtered at
    once, which bounds the memory: some thirty planes are kept of them. The result does not depend on it.
    """
    smooth = np.empty(plane.shape, dtype=np.float32)
    height = len(plane)
    for top in range(0, height, rows):
        bottom = min(top + rows, height)
        low, high = max(0, top - 2 * radius), min(height, bottom + 2 * radius)  # a mean of means reaches this far
        band = _filtered(guide[low:high], plane[low:high], radius, eps)
        smooth[top:bottom] = band[top - low : bottom - low]
    return smooth


def _filtered(guide: Array, plane: Array, radius: int, eps: float) -> Array:
    guide = np.asarray(guide).astype(np.float32, copy=False)
    plane = np.asarray(plane).astype(np.float32, copy=False)
    slope: Array
    mean_plane: Array = box_mean(plane, radius)
    mean = box_mean(guide, radius)
    if guide.ndim == 2:
        variance = box_mean(guide * guide, radius) - mean * mean
        slope = (box_mean(guide * plane, radius) - mean * mean_plane) / (variance + eps)
        offset = mean_plane - slope * mean
        return np.asarray(box_mean(slope, radius) * guide + box_mean(offset, radius))
    covariance = box_mean(guide * plane[..., None], radius) - mean * mean_plane[..., None]
    slope = _solved(_windows(guide, mean, radius, eps), covariance)
    offset = mean_plane - (slope * mean).sum(axis=-1)
    return (box_mean(slope, radius) * guide).sum(axis=-1) + box_mean(offset, radius)


def box_mean(image: Array, radius: int) -> Array:
    """Return the mean of each pixel's square window, cut at the border; image: (H, W) or (H, W, C) float32."""
    import cv2

    size, outside = (2 * radius + 1, 2 * radius + 1), cv2.BORDER_CONSTANT
    total = cv2.boxFilter(np.ascontiguousarray(image), cv2.CV_32F, size, normalize=False, borderType=outside)
    height, width = (_counts(n, radius) for n in image.shape[:2])
    count = height[:, None] * width
    return np.asarray(total / (count if image.ndim == 2 else count[..., None]))


def _counts(length: int, radius: int) -> Array:
    """How many of a line's pixels the window of each one holds (length,)."""
    at = np.arange(length)
    return (np.minimum(at + radius, length - 1) - np.maximum(at - radius, 0) + 1).astype(np.float32)


def _windows(guide: Array, mean: Array, radius: int, eps: float) -> dict[tuple[int, int], Array]:
    """The upper half of each window's covariance of the guide's channels, eps added on its diagonal."""
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    return {
        (i, j): box_mean(guide[..., i] * guide[..., j], radius) - mean[..., i] * mean[..., j] + eps * (i == j)
        for i, j in pairs
    }


def _solved(window: dict[tuple[int, int], Array], right: Array) -> Array:
    """Solve each pixel's symmetric 3 x 3 system by its adjugate: a plane of 24 megapixels has as many of them."""
    a, b, c, d, e, f = (window[k].astype(np.float64) for k in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)))
    adjugate = ((d * f - e * e, c * e - b * f, b * e - c * d), (a * f - c * c, b * c - a * e), (a * d - b * b,))
    determinant = a * adjugate[0][0] + b * adjugate[0][1] + c * adjugate[0][2]
    x, y, z = (right[..., k] for k in range(3))
    (A, B, C), (D, E), (F,) = adjugate
    rows = (A * x + B * y + C * z, B * x + D * y + E * z, C * x + E * y + F * z)
    return np.stack([(row / determinant).astype(np.float32) for row in rows], axis=-1)
