"""Fusion: one photo becomes two corrected inputs, blended pixel by pixel and scale by scale.

`fusion_2012`: Ancuti, Ancuti, Haber & Bekaert 2012, Enhancing underwater images and videos by fusion, CVPR.
`fusion_2018`: Ancuti, Ancuti, De Vleeschouwer & Bekaert 2018, Color balance and fusion for underwater image
enhancement, IEEE TIP 27 (1). "Luminance" is Rec. 601 luma of the gamma-encoded channels, so that gray has
saturation 0. Weights of an input are summed, and normalised over the inputs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sucre_bench import Restoration, Scene, View, method
from sucre_bench.arrays import Array
from sucre_bench.imaging.filters.bilateral import denoised
from sucre_bench.imaging.filters.lab import equalised
from sucre_bench.imaging.filters.luma import luma
from sucre_bench.imaging.filters.pyramid import blended, most_levels
from sucre_bench.imaging.filters.saliency import binomial, saliency
from sucre_bench.imaging.filters.white_balance import gray_world, mid_gray_gain, red_from_green
from sucre_bench.plugins.ranges import check_ranges

_EXPOSED = 0.25  # sigma of the exposedness weight (2012)
_REGULARISER = 0.1  # delta: every input contributes a little everywhere (2018)


@method(name="fusion_2012", requires=("cv2",), cites="Ancuti, Ancuti, Haber & Bekaert 2012", encoding="gamma")
@dataclass(frozen=True)
class Fusion2012:
    """Blend the white-balanced photo with a denoised, locally equalised version of it.

    Weights: Laplacian contrast, local contrast, saliency and exposedness.
    """

    illuminant: float = 0.2
    """Lambda in mu_I = 0.5 + lambda mu_ref, the mean each channel is brought to; 0 = mid gray, 0.1 to 0.3 published."""

    noise: float = 0.1
    """Differences of colour, in [0, 1], that count as noise and are smoothed before equalisation; 0 = none are."""

    clip: float = 2.0
    """How steep equalisation may be: the limit of a histogram's bin, in multiples of the mean bin; 256 = no limit."""

    tiles: int = 4
    """Tiles of the equalisation along each side of the image."""

    levels: int = 5
    """Levels of the pyramid; an image too small for them has fewer."""

    def __post_init__(self) -> None:
        check_ranges(self, illuminant="[0, 10]", noise="[0, 1]", clip="(0, 256]", tiles="[1, 256]", levels="[1, 32]")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image, in [0, 1]."""
        balanced = _balanced(view.rgb, self.illuminant)
        # A bilateral filter is a still image's share of the publication's temporal one.
        equal = equalised(denoised(balanced, self.noise), self.clip, self.tiles)
        return Restoration(_fused(balanced, equal, _weight_2012, 0, self.levels))


@method(
    name="fusion_2018",
    requires=("cv2",),
    cites="Ancuti, Ancuti, De Vleeschouwer & Bekaert 2018",
    encoding="gamma",
)
@dataclass(frozen=True)
class Fusion2018:
    """Give red back from green, balance by gray world, and blend a gamma-corrected with a sharpened version.

    Weights: Laplacian contrast, saliency and saturation.
    """

    red: float = 1.0
    """How much of red's lack, against green, is given back: alpha of eq. 4."""

    blue: float = 0.0
    """The same for blue: for turbid, greenish water, where blue is lacking too; 1 there."""

    gamma: float = 1.2
    """Exponent of the first input; above 1 darkens, for white-balanced underwater images tend to be too bright."""

    blur_px: float = 20.0
    """Standard deviation of the Gaussian of the unsharp mask, pixels."""

    levels: int | None = None
    """Levels of the pyramid; none = as many as the image has room for."""

    def __post_init__(self) -> None:
        check_ranges(self, red="[0, 10]", blue="[0, 10]", gamma="(0, 10]", blur_px="(0, 200]", levels="[1, 32]")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image, in [0, 1]."""
        lifted = red_from_green(view.rgb, self.red)
        if self.blue:
            lifted = red_from_green(lifted[..., ::-1], self.blue)[..., ::-1]  # the same equation with blue for red
        balanced = np.ascontiguousarray(gray_world(lifted))
        levels = self.levels or most_levels(balanced.shape[:2])
        darker, sharper = balanced ** np.float32(self.gamma), _sharpened(balanced, self.blur_px)
        return Restoration(_fused(darker, sharper, _weight_2018, _REGULARISER, levels))


def _balanced(rgb: Array, illuminant: float) -> Array:
    """Bring each channel's mean mu_ref to mu_I = 0.5 + lambda mu_ref (2012), cut at 1; black stays black.

    So the stronger channels stay a little ahead: gray world would redden water in which hardly any red is left.
    """
    return np.minimum(rgb * mid_gray_gain(rgb, illuminant), 1)


def _sharpened(rgb: Array, blur_px: float) -> Array:
    """S = (I + N{I - G * I}) / 2 (2018); N brings all three channels to [0, 1] by one shift and one scale."""
    import cv2

    detail = rgb - cv2.GaussianBlur(rgb, (0, 0), blur_px)
    low, high = float(detail.min()), float(detail.max())
    if high - low < 1e-4:  # no detail but rounding: nothing to sharpen
        return rgb
    return (rgb + (detail - low) / (high - low)) / 2


def _fused(first: Array, second: Array, weight: Callable[[Array], Array], regulariser: float, levels: int) -> Array:
    """Blend two inputs (H, W, 3) by their normalised weights, (W_k + delta) / sum (W_k + delta)."""
    weights = np.stack([weight(first), weight(second)]) + np.float32(regulariser)  # (2, H, W)
    weights /= weights.sum(axis=0)
    return blended((first, second), tuple(weights), levels).clip(0, 1)


def _weight_2012(rgb: Array) -> Array:
    """(H, W): Laplacian contrast, local contrast, saliency and exposedness, summed."""
    light = luma(rgb)
    contrast = (light - binomial(light)) ** 2
    exposed = np.exp(-((light - 0.5) ** 2) / (2 * _EXPOSED**2))
    return _laplacian(light) + contrast + saliency(rgb) + exposed


def _weight_2018(rgb: Array) -> Array:
    """(H, W): Laplacian contrast, saliency and saturation, summed."""
    light = luma(rgb)
    saturation = np.sqrt(((rgb - light[..., None]) ** 2).mean(axis=-1))
    return _laplacian(light) + saliency(rgb) + saturation


def _laplacian(light: Array) -> Array:
    import cv2

    return np.abs(cv2.Laplacian(light, cv2.CV_32F))
