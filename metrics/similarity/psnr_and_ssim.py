"""Similarity to a reference image: PSNR and SSIM.

Both compare in [0, 1], gamma-encoded, over the pixels that the view has depth for (all, where it has no depth map) and
that the method gave a colour: the mean is taken over those pixels alone. (Blackening the rest in both images and
averaging over everything would add -10 log10(area) dB, 13 dB at 5 %.) The variants "unmasked" take every pixel, holes
as black, as most published tables do. Each score's coverage is the share of the image's pixels it is made of.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array, Mask
from sucre_bench.errors import InputError
from sucre_bench.imaging.encoding import srgb_encode, to_8bit
from sucre_bench.imaging.once import coloured_pixels
from sucre_bench.imaging.resizing import Resizing, resized
from sucre_bench.metrics.similarity.loops import RADIUS, mean_ssim, squared_error
from sucre_bench.plugins.decorators import metric
from sucre_bench.scene import Restoration, Score, View

_GRAY = Resizing(256)


@metric(
    role="similarity",
    needs={"reference"},
    requires=["numba", "PIL"],
    unit="dB",
    better="higher",
    range=(-np.inf, np.inf),
    variants={
        "masked": "the shown picture, over pixels with depth and a colour",
        "unmasked": "the shown picture, all pixels, holes as black",
        "raw": "the computed image, neither stretched nor clipped, over pixels with depth and a colour",
        "luma": "as masked, of luma (.299, .587, .114), in 8 bits",
        "gray": "luma of both pictures brought to 256x256 in 8 bits (Pillow's bicubic), all pixels, holes as black, as"
        " in xahidbuffon/FUnIE-GAN",
    },
)
@dataclass(frozen=True)
class Psnr:
    """Peak signal-to-noise ratio to the reference, 10 log10(1 / MSE) over all channels; infinite for equal images.

    "raw" compares in the view's own encoding: what a method computed, before any normalisation for display.
    """

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterator[Score]:
        """Yield one score; nothing where the view has no reference."""
        if view.reference is None:
            return
        raw = variant == "raw"
        image, reference = _pair(restored.image if raw else shown, view, encode=not raw)
        mask = _scored(image, reference, view) if variant in ("masked", "raw", "luma") else coloured_pixels(reference)
        if variant == "gray":
            image, reference = (resized(to_8bit(x), _GRAY) for x in (image, reference))
            mask = np.ones((_GRAY.side, _GRAY.side), np.bool_)
        if variant in ("luma", "gray"):
            image, reference = (_luma_8bit(x) for x in (image, reference))
        n = np.count_nonzero(mask) * image.shape[-1]
        with np.errstate(divide="ignore"):  # equal images
            value = -10 * np.log10(squared_error(image, reference, mask) / n) if n else np.nan
        yield _score(float(value), mask)


@metric(
    role="similarity",
    needs={"reference"},
    requires=["cv2", "numba"],
    unit="",
    better="higher",
    range=(-1, 1),
    cites="Wang et al. 2004",
    variants={
        "gaussian": "Gaussian window, sigma 1.5, 11x11, as published; mean of the three channels",
        "uniform7": "uniform window 7x7, sample covariances (scikit-image's default)",
        "gray": "as gaussian, on luma (.299, .587, .114)",
        "gaussian-unmasked": "as gaussian, all pixels, holes as black",
        "uniform7-unmasked": "as uniform7, all pixels, holes as black",
        "gray-unmasked": "as gray, all pixels, holes as black",
    },
)
@dataclass(frozen=True)
class Ssim:
    """Structural similarity to the reference (Wang et al. 2004), K1 = .01, K2 = .03, data range 1.

    Masked variants average over the pixels whose whole window has a colour and depth, so that no hole bleeds into the
    score; as in the original, windows that leave the image count nowhere.
    """

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterator[Score]:
        """Yield one score; nothing where the view has no reference."""
        if view.reference is None:
            return
        window, _, unmasked = variant.partition("-")
        image, reference = _pair(shown, view, encode=True)
        mask = coloured_pixels(reference) if unmasked else _scored(image, reference, view)
        if window == "gray":
            image, reference = (_luma(np.nan_to_num(x, nan=0.0)) for x in (image, reference))
        weights, norm = _WINDOWS["uniform7" if window == "uniform7" else "gaussian"]
        whole = _whole_windows(mask, int(np.count_nonzero(weights)) // 2)
        if not whole.any():
            yield Score(np.nan, n_pixels=0, coverage=0.0)
            return
        yield _score(mean_ssim(image, reference, weights, norm, whole), whole)


def _gaussian(sigma: float) -> Array:
    weights = np.exp(-(np.arange(-RADIUS, RADIUS + 1) ** 2) / (2 * sigma**2))
    return np.asarray(weights / weights.sum())


# Weights along a row and a column, and what variances are multiplied by.
_WINDOWS = {"gaussian": (_gaussian(1.5), 1.0), "uniform7": (np.array([0, 0, *[1 / 7] * 7, 0, 0]), 49 / 48)}


def _whole_windows(mask: Mask, radius: int) -> Mask:
    """The centres of windows that lie in the image and in the mask as a whole."""
    import cv2

    whole = mask
    if not mask.all():
        box = np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)
        whole = cv2.erode(mask.astype(np.uint8), box) > 0
    whole = whole.copy()
    whole[:radius] = whole[-radius:] = whole[:, :radius] = whole[:, -radius:] = False
    return whole


def _pair(image: Array, view: View, encode: bool) -> tuple[Array, Array]:
    """The image and the view's reference, which is gamma-encoded if asked for; InputError when their sizes differ."""
    reference = view.reference
    assert reference is not None
    if reference.shape != image.shape:
        (h, w), (rh, rw) = image.shape[:2], reference.shape[:2]
        raise InputError(f"{view.name}: the reference is {rw}x{rh}, the image {w}x{h}; give both in one size")
    if encode and view.encoding == "linear":
        reference = srgb_encode(reference).astype(np.float32)
    return image, reference


def _scored(image: Array, reference: Array, view: View) -> Mask:
    return coloured_pixels(image) & coloured_pixels(reference) & view.valid


def _luma(image: Array) -> Array:
    """(H, W, 1), of an image (H, W, 3)."""
    return np.asarray(image @ np.array([[0.299], [0.587], [0.114]], dtype=image.dtype))


def _luma_8bit(image: npt.NDArray[Any]) -> Array:
    """(H, W, 1) in [0, 1], of an image (H, W, 3) in 8 bits or in [0, 1]: whole levels of 255, as files hold them."""
    levels = image if image.dtype == np.uint8 else to_8bit(image)
    return np.asarray(np.floor(_luma(levels.astype(np.float64)) + 0.5) / 255)


def _score(value: float, mask: Mask) -> Score:
    return Score(value, n_pixels=int(mask.sum()), coverage=float(mask.mean()))
