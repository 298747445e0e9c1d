"""Similarity to a reference image: PSNR and SSIM.

Both compare in [0, 1], gamma-encoded, over the pixels that the view has depth for (all, where it has no depth map) and
that the method gave a colour: the mean is taken over those pixels alone. (Blackening the rest in both images and
averaging over everything would add -10 log10(area) dB, 13 dB at 5 %.) The variants "unmasked" take every pixel, holes
as black, as most published tables do. Each score's coverage is the share of the image's pixels it is made of.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.errors import InputError
from sucre_bench.imaging.encoding import srgb_encode
from sucre_bench.plugins.decorators import metric
from sucre_bench.scene import Restoration, Score, View

__all__ = ["Psnr", "Ssim"]


@metric(
    needs={"reference"},
    unit="dB",
    better="higher",
    range=(-np.inf, np.inf),
    variants={
        "masked": "the shown picture, over pixels with depth and a colour",
        "unmasked": "the shown picture, all pixels, holes as black",
        "raw": "the computed image, neither stretched nor clipped, over pixels with depth and a colour",
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
        mask = _finite(reference) if variant == "unmasked" else _scored(image, reference, view)
        image = np.nan_to_num(image, nan=0.0)
        error = image[mask].astype(np.float64) - reference[mask]
        with np.errstate(divide="ignore"):  # equal images
            value = -10 * np.log10(np.mean(error**2)) if mask.any() else np.nan
        yield _score(float(value), mask)


@metric(
    needs={"reference"},
    requires=["cv2", "skimage"],
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
        import cv2
        from skimage.metrics import structural_similarity

        if view.reference is None:
            return
        window, _, unmasked = variant.partition("-")
        image, reference = _pair(shown, view, encode=True)
        mask = _finite(reference) if unmasked else _scored(image, reference, view)
        image, reference = np.nan_to_num(image, nan=0.0), np.nan_to_num(reference, nan=0.0)
        if window == "gray":
            image, reference = _luma(image), _luma(reference)
        size = 7 if window == "uniform7" else 11
        box = np.ones((size, size), np.uint8)
        whole = cv2.erode(mask.astype(np.uint8), box, borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
        if not whole.any():
            yield Score(np.nan, n_pixels=0, coverage=0.0)
            return
        gaussian = window != "uniform7"
        _, ssim = structural_similarity(
            image,
            reference,
            win_size=size,
            gaussian_weights=gaussian,
            sigma=1.5,
            use_sample_covariance=not gaussian,
            data_range=1.0,
            channel_axis=None if window == "gray" else -1,
            full=True,
        )
        yield _score(float(ssim[whole].mean(dtype=np.float64)), whole)


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
    return _finite(image) & _finite(reference) & view.valid


def _finite(image: Array) -> Mask:
    return np.asarray(np.isfinite(image).all(axis=-1))


def _luma(image: Array) -> Array:
    return np.asarray(image @ np.array([0.299, 0.587, 0.114], dtype=image.dtype))


def _score(value: float, mask: Mask) -> Score:
    return Score(value, n_pixels=int(mask.sum()), coverage=float(mask.mean()))
