"""Image filters that several methods use. If OpenCV or scikit-image has a filter, it is used here.

Planes are (H, W) and images (H, W, 3) float32 RGB in [0, 1]. White balance takes gamma-encoded intensities;
the others work on linear intensities, too. No filter changes its input.
"""

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.cielab import from_lab, to_lab
from sucre_bench.imaging.display import gray_world_gain

_ACROSS = 5  # pixels of the window
_SPACE = 3.0  # spatial standard deviation, in pixels


def denoised(rgb: Array, noise: float) -> Array:
    """Return the image (H, W, 3) float32 after a bilateral filter; itself where noise is 0.

    noise: standard deviation, in intensity, of the differences of colour that count as noise.
    """
    import cv2

    return np.asarray(cv2.bilateralFilter(rgb, _ACROSS, noise, _SPACE)) if noise else rgb


def equalised(rgb: Array, clip: float, tiles: int) -> Array:
    """Equalise the lightness within tiles, its slope limited, hue and chroma kept.

    rgb: (H, W, 3), [0, 1]; clip: limit of the histogram, in multiples of its mean; tiles: how many along each side.
    Lightness is taken at 256 levels, for which published values of `clip` are meant.
    """
    import cv2

    lab = to_lab(rgb)
    lightness = np.rint(lab[..., 0] * 2.55).astype(np.uint8)
    lab[..., 0] = cv2.createCLAHE(clip, (tiles, tiles)).apply(lightness) / np.float32(2.55)
    return from_lab(lab)


def window_max(plane: Array, size: int) -> Array:
    """Return the greatest value (H, W) in each pixel's window, cut at the border."""
    import cv2

    return np.asarray(
        cv2.dilate(
            np.ascontiguousarray(plane, dtype=np.float32), np.ones((size, size), np.uint8)
        )
    )


_FLAT = 1e-6  # a range of intensities below this is no contrast
_CUT = 0.005  # share of the strongest channel's pixels that the simplest colour balance cuts at each end


def red_from_green(rgb: Array, strength: float = 1.0) -> Array:
    """Return the image with red lifted where green is strong: R + strength (mean G - mean R) (1 - R) G.

    Ancuti et al. 2018, eq. 4. Nothing is lifted where the mean of red is at least that of green.
    """
    red, green = rgb[..., 0], rgb[..., 1]
    lacking = max(0.0, float(green.mean(dtype=np.float64) - red.mean(dtype=np.float64)))
    lifted = red + np.float32(strength * lacking) * (1 - red) * green
    return np.stack([lifted, green, rgb[..., 2]], axis=-1)


def gray_world(rgb: Array) -> Array:
    """Return the image with channels scaled to equal means (Buchsbaum 1980), cut at 1; a black channel stays black."""
    gain = gray_world_gain(rgb.reshape(-1, 3)).astype(np.float32)
    return np.minimum(rgb * gain, 1)


def stretched_together(rgb: Array, percent: float) -> Array:
    """Return the image in [0, 1], stretched by one gain and one offset for all three channels.

    percent: share of all values, in percent, that becomes 0, and as many 1. An image without contrast is only clipped.
    """
    low, high = (float(value) for value in np.percentile(rgb, [percent, 100 - percent]))
    if high - low < _FLAT:
        return rgb.clip(0, 1)
    return ((rgb - np.float32(low)) / np.float32(high - low)).clip(0, 1)


def stretched_by_weakness(rgb: Array) -> Array:
    """Return the image with each channel stretched to [0, 1] by itself; the weaker a channel, the more of it is cut.

    At both ends a share of 0.005 max(sum R, sum G, sum B) / sum of the channel is cut, always less than half. Without
    that bound a channel that is nearly black would be inverted. A constant channel stays as it is. This variant of the
    simplest colour balance (Limare et al. 2011) is that of Water-Net's authors and of public programs for Ancuti et al.
    2012.
    """
    total = rgb.sum(axis=(0, 1), dtype=np.float64)
    cut = np.minimum(_CUT * total.max() / np.maximum(total, 1e-12), 0.49)
    channels = []
    for c in range(3):
        # MATLAB's quantiles: the k-th of n values is at (k - .5) / n.
        bottom, top = np.quantile(rgb[..., c], [cut[c], 1 - cut[c]], method="hazen").astype(
            np.float32
        )
        flat = top - bottom < _FLAT
        channels.append(
            rgb[..., c] if flat else ((rgb[..., c] - bottom) / (top - bottom)).clip(0, 1)
        )
    return np.stack(channels, axis=-1)


def guided_filter(
    guide: Array, plane: Array, radius: int, eps: float, *, rows: int = 512
) -> Array:
    """Return a plane (H, W) float32 that is, in each window, the linear function of the guide nearest to `plane`.

    guide: (H, W) or (H, W, 3), [0, 1]; radius: of the square window, pixels; eps: variance of the guide below which it
    counts as flat (eqs. 5 and 6, in colour 14 and 15). Windows are cut at the image's border. rows: filtered at
    once, which bounds the memory: some thirty planes are kept of them. The result does not depend on it.
    """
    smooth = np.empty(plane.shape, dtype=np.float32)
    height = len(plane)
    for top in range(0, height, rows):
        bottom = min(top + rows, height)
        # a mean of means reaches this far
        low, high = (
            max(0, top - 2 * radius),
            min(height, bottom + 2 * radius),
        )
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
    # Each window's covariance of the guide's channels, eps on its diagonal: a b c, b d e, c e f. Each pixel's system is
    # solved by the adjugate: a plane of 24 megapixels has as many of them.
    a, b, c, d, e, f = (
        (
            box_mean(guide[..., i] * guide[..., j], radius)
            - mean[..., i] * mean[..., j]
            + eps * (i == j)
        ).astype(np.float64)
        for i in range(3)
        for j in range(i, 3)
    )
    A, B, C = (d * f - e * e, c * e - b * f, b * e - c * d)
    D, E = (a * f - c * c, b * c - a * e)
    F = a * d - b * b
    determinant = a * A + b * B + c * C
    x, y, z = (covariance[..., k] for k in range(3))
    rows = (A * x + B * y + C * z, B * x + D * y + E * z, C * x + E * y + F * z)
    slope = np.stack([(row / determinant).astype(np.float32) for row in rows], axis=-1)
    offset = mean_plane - (slope * mean).sum(axis=-1)
    return (box_mean(slope, radius) * guide).sum(axis=-1) + box_mean(offset, radius)


def box_mean(image: Array, radius: int) -> Array:
    """Return the mean of each pixel's square window, cut at the border; image: (H, W) or (H, W, C) float32."""
    import cv2

    size = (2 * radius + 1, 2 * radius + 1)
    outside = cv2.BORDER_CONSTANT
    total = cv2.boxFilter(
        np.ascontiguousarray(image), cv2.CV_32F, size, normalize=False, borderType=outside
    )
    places = (np.arange(side) for side in image.shape[:2])
    rows, columns = (
        (np.minimum(at + radius, len(at) - 1) - np.maximum(at - radius, 0) + 1).astype(
            np.float32
        )
        for at in places
    )
    count = rows[:, None] * columns
    return np.asarray(total / (count if image.ndim == 2 else count[..., None]))
