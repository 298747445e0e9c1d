"""White balance: red raised from green, gray world by scaling or by shifting, and contrast stretches."""

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.display import gray_world_gain

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


def mid_gray_gain(rgb: Array) -> Array:
    """Return the (3,) float32 factors that bring each channel's mean to 0.5; 1 for a black channel."""
    mean = rgb.mean(axis=(0, 1), dtype=np.float64)
    there = mean > 1e-6
    return np.where(there, 0.5 / np.where(there, mean, 1), 1).astype(np.float32)


def shifted_to_gray(rgb: Array, cast: float) -> Array:
    """Return the image with each channel's mean mu moved to 0.5 + cast * mu by adding a constant; it may leave [0, 1].

    cast: share of the colour cast that stays; 0 removes all of it. A shift keeps each channel's contrast, so a channel
    with little light gains no noise.
    """
    mean = rgb.mean(axis=(0, 1), dtype=np.float64)
    return rgb + (0.5 + (cast - 1) * mean).astype(np.float32)


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

    At both ends a share of 0.005 max(sum R, sum G, sum B) / sum of the channel is cut, always less than half: without
    that bound a channel that is nearly black would be inverted. A constant channel stays as it is. This variant of the
    simplest colour balance (Limare et al. 2011) is that of Water-Net's authors and of public programs for Ancuti et
    al. 2012.
    """
    total = rgb.sum(axis=(0, 1), dtype=np.float64)
    cut = np.minimum(_CUT * total.max() / np.maximum(total, 1e-12), 0.49)
    channels = []
    for c in range(3):
        # MATLAB's quantiles: the k-th of n values is at (k - .5) / n.
        bottom, top = np.quantile(rgb[..., c], [cut[c], 1 - cut[c]], method="hazen").astype(np.float32)
        flat = top - bottom < _FLAT
        channels.append(rgb[..., c] if flat else ((rgb[..., c] - bottom) / (top - bottom)).clip(0, 1))
    return np.stack(channels, axis=-1)
