"""Fusion: make two corrected inputs of one photograph and blend them by pixel and by scale.

`fusion_2012`: Ancuti, Ancuti, Haber & Bekaert 2012, Enhancing underwater images and videos by fusion, CVPR.
`fusion_2018`: Ancuti, Ancuti, De Vleeschouwer & Bekaert 2018, Color balance and fusion for underwater image
enhancement, IEEE TIP 27 (1). Both use the Rec. 601 luma of the gamma-encoded channels as luminance, so that gray has
saturation 0. Each input's weights are summed, then normalised over the two inputs.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sucre_bench import Restoration, Scene, View, method
from sucre_bench.arrays import Array
from sucre_bench.imaging import filters
from sucre_bench.imaging.cielab import luma, to_lab
from sucre_bench.plugins.options import check_ranges

_EXPOSED = 0.25  # sigma of the exposedness weight (2012)
_REGULARISER = 0.1  # delta (2018): every input contributes a little everywhere


@method(
    name="fusion_2012",
    requires=("cv2",),
    cites="Ancuti, Ancuti, Haber & Bekaert 2012",
    encoding="gamma",
    opinions={"SOTA (0 to 100)": 51.2},
)
@dataclass(frozen=True)
class Fusion2012:
    """Blend the white-balanced photograph with a denoised version of it whose contrast is raised locally.

    The white balance moves the mean mu of each channel to 0.5 + illuminant * mu, then stretches all channels together.
    The weights are Laplacian contrast, local contrast, saliency and exposedness.
    """

    balance: Literal["shift", "stretch"] = "shift"
    """shift: move the means of the channels, as in the authors' own pictures; stretch: stretch each channel separately,
    like the public programs whose results most published tables show."""

    illuminant: float = 0.1
    """Lambda in mu_I = 0.5 + lambda mu_ref (balance=shift): the share of the colour cast that stays. 0 removes all of
    it; 0.1 to 0.3 are published."""

    percent: float = 0.1
    """Percent of all values that become 0, and as many 1 (balance=shift); 0 stretches from minimum to maximum."""

    noise: float = 0.1
    """Colour differences, in [0, 1], that the bilateral filter smooths as noise; 0 switches the filter off."""

    clip: float = 2.0
    """Contrast limit of the local equalisation, in multiples of a histogram's mean bin; 256 switches the limit off."""

    tiles: int = 8
    """Tiles of the equalisation along each side of the image."""

    levels: int = 5
    """Levels of the pyramid; a small image has fewer."""

    def __post_init__(self) -> None:
        check_ranges(self, illuminant="[0, 1]", percent="[0, 50)", noise="[0, 1]")
        check_ranges(self, clip="(0, 256]", tiles="[1, 256]", levels="[1, 32]")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image, in [0, 1]."""
        if self.balance == "stretch":
            balanced = filters.stretched_by_weakness(view.rgb)
        else:
            # A shift keeps each channel's contrast, so a channel with little light gains no noise.
            shift = (
                0.5 + (self.illuminant - 1) * view.rgb.mean(axis=(0, 1), dtype=np.float64)
            ).astype(np.float32)
            balanced = filters.stretched_together(view.rgb + shift, self.percent)
        # The publication filters noise over time; a single photograph gets a bilateral filter in its place.
        equal = filters.equalised(filters.denoised(balanced, self.noise), self.clip, self.tiles)
        return Restoration(blend(balanced, equal, weight_2012, 0, self.levels))


@method(
    name="fusion_2018",
    requires=("cv2",),
    cites="Ancuti, Ancuti, De Vleeschouwer & Bekaert 2018",
    encoding="gamma",
    differs="darker and more violet than its figures; it is written from the equations, no picture of its authors is "
    "public, and a public port that also stretches each channel is 13 to 21 dB away",
    opinions={"SOTA (0 to 100)": 61.3, "UID2021": 5.9},
)
@dataclass(frozen=True)
class Fusion2018:
    """Raise red from green, balance by gray world, and blend a gamma-corrected with a sharpened version.

    The weights are Laplacian contrast, saliency and saturation.
    """

    red: float = 1.0
    """Share of the difference from green that red gets back: alpha of eq. 4; 0 switches this off."""

    blue: float = 0.0
    """The same for blue, which greenish, turbid water absorbs, too: use 1 there; 0 switches this off."""

    gamma: float = 1.2
    """Exponent of the first input; above 1 darkens, since white-balanced underwater images tend to be too bright."""

    blur_px: float = 20.0
    """Standard deviation of the unsharp mask's Gaussian, pixels."""

    levels: int | None = None
    """Levels of the pyramid; null = as many as the image has room for."""

    def __post_init__(self) -> None:
        check_ranges(
            self,
            red="[0, 10]",
            blue="[0, 10]",
            gamma="(0, 10]",
            blur_px="(0, 200]",
            levels="[1, 32]",
        )

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image, in [0, 1]."""
        lifted = filters.red_from_green(view.rgb, self.red)
        if self.blue:
            # The same equation with blue for red.
            lifted = filters.red_from_green(lifted[..., ::-1], self.blue)[..., ::-1]
        balanced = np.ascontiguousarray(filters.gray_world(lifted))
        levels = self.levels or most_levels(balanced.shape[:2])
        darker = balanced ** np.float32(self.gamma)
        sharper = sharpened(balanced, self.blur_px)
        return Restoration(blend(darker, sharper, weight_2018, _REGULARISER, levels))


def sharpened(rgb: Array, blur_px: float) -> Array:
    """Return S = (I + N{I - G * I}) / 2 (2018); N brings the three channels to [0, 1] by one offset and one factor.

    rgb: (H, W, 3) float32; blur_px: standard deviation of the Gaussian G. An image without detail is returned as it is.
    """
    import cv2

    detail = rgb - cv2.GaussianBlur(rgb, (0, 0), blur_px)
    low, high = float(detail.min()), float(detail.max())
    if high - low < 1e-4:  # only rounding errors: there is nothing to sharpen
        return rgb
    return (rgb + (detail - low) / (high - low)) / 2


def blend(
    first: Array,
    second: Array,
    weight: Callable[[Array], Array],
    regulariser: float,
    levels: int,
) -> Array:
    """Return two inputs (H, W, 3) blended by their normalised weights, (W_k + delta) / sum (W_k + delta), in [0, 1]."""
    weights = np.stack([weight(first), weight(second)]) + np.float32(regulariser)  # (2, H, W)
    weights /= weights.sum(axis=0)
    return blended((first, second), tuple(weights), levels).clip(0, 1)


def weight_2012(rgb: Array) -> Array:
    """Return (H, W): the sum of Laplacian contrast, local contrast, saliency and exposedness."""
    light = luma(rgb)
    contrast = (light - binomial(light)) ** 2
    exposed = np.exp(-((light - 0.5) ** 2) / (2 * _EXPOSED**2))
    return _laplacian(light) + contrast + saliency(rgb) + exposed


def weight_2018(rgb: Array) -> Array:
    """Return (H, W): the sum of Laplacian contrast, saliency and saturation."""
    light = luma(rgb)
    saturation = np.sqrt(((rgb - light[..., None]) ** 2).mean(axis=-1))
    return _laplacian(light) + saliency(rgb) + saturation


def _laplacian(light: Array) -> Array:
    import cv2

    return np.abs(cv2.Laplacian(light, cv2.CV_32F))


def saliency(rgb: Array) -> Array:
    """Return (H, W) float32: how far each pixel's smoothed colour is from the image's mean colour, in L*a*b* / 100.

    rgb: (H, W, 3) in [0, 1]. Without the division by the image's maximum that is for display, so that maps of two
    images can be compared. The unit is the distance from black to white.
    """
    lab = to_lab(rgb) / 100
    mean = lab.mean(axis=(0, 1), dtype=np.float64).astype(np.float32)
    return np.asarray(np.linalg.norm(binomial(lab) - mean, axis=-1))


def binomial(image: Array) -> Array:
    """Return the image smoothed by the 5 x 5 binomial kernel (1 4 6 4 1) / 16; (H, W) or (H, W, C) float32.

    Its response falls to a half at pi / 2.75, the cut-off that is named w_hc where it is used.
    """
    import cv2

    kernel = np.array([1, 4, 6, 4, 1], np.float32) / 16
    return np.asarray(cv2.sepFilter2D(image, -1, kernel, kernel))


def blended(images: Sequence[Array], weights: Iterable[Array], levels: int) -> Array:
    """Return the images' weighted mean (H, W, 3), taken in each band of a pyramid: R_l = sum_k G_l(W_k) L_l(I_k).

    images: (H, W, 3) float32; weights: (H, W) float32, one an image, of sum 1 at every pixel; levels: of the pyramid,
    1 or more, the last one low-pass; at most `most_levels`. Values may leave the images' range near strong edges.
    """
    import cv2

    levels = min(levels, most_levels(images[0].shape[:2]))
    sums: list[Array] = []
    for image, weight in zip(images, weights, strict=True):
        for level, band in enumerate(_bands(image, levels)):
            weight = np.asarray(cv2.pyrDown(weight)) if level else weight
            if level == len(sums):
                sums.append(band * weight[..., None])
            else:
                sums[level] += band * weight[..., None]
    result = sums.pop()
    while sums:
        finer = sums.pop()
        result = finer + np.asarray(cv2.pyrUp(result, dstsize=(finer.shape[1], finer.shape[0])))
    return result


def most_levels(shape: tuple[int, ...]) -> int:
    """Return how many levels an image of shape (H, W) has room for: the smaller side of the last is 2 to 4 pixels."""
    return max(1, min(shape).bit_length() - 1)


def _bands(image: Array, levels: int) -> Iterator[Array]:
    """The Laplacian pyramid from fine to coarse: what each level has that the next has not, and the last level."""
    import cv2

    for _ in range(levels - 1):
        coarse: Array = np.asarray(cv2.pyrDown(image))
        yield image - np.asarray(cv2.pyrUp(coarse, dstsize=(image.shape[1], image.shape[0])))
        image = coarse
    yield image
