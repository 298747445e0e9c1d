"""uciqe: values of public programs on public pictures, published scores, float64 references, and holes."""

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from support.places import u45_rows

from sucre_bench.arrays import Array
from sucre_bench.imaging.image_files import read_rgb
from sucre_bench.metrics.uciqe import Uciqe
from sucre_bench.scene import Arrays, Restoration, Score, View

VARIANTS = tuple(Uciqe.__plugin__.variants)
Bytes = npt.NDArray[np.uint8]


def score(shown: Array, variant: str = "yang2015") -> Score:
    (found,) = Uciqe().score(Restoration(shown), shown, View("a.png", Arrays(shown)), variant)
    return found


def of(pixels: Any, variant: str = "yang2015") -> float:
    """Of 8-bit pixels (P, 3) or (H, W, 3)."""
    return score(
        np.float32(np.atleast_3d(pixels).reshape(-1, 1, 3)) / np.float32(255), variant
    ).value


def picture(name: str) -> Bytes:
    from skimage import data

    return np.asarray(getattr(data, name)())


# of public programs: the scores of the astronaut and of the coffee, and their last digit
PUBLIC = {
    "yang2015": (0.688, 0.663, 0.001),
    "matlab": (0.691, 0.665, 0.001),
    "ratio": (2.12, 1.41, 0.01),
    "cielab": (38.4, 35.5, 0.1),
    "cielab-range": (38.6, 36.7, 0.1),
    "hue": (0.520, 0.474, 0.001),
    "centred": (0.404, 0.420, 0.001),
}


@pytest.mark.parametrize("variant", PUBLIC)
def test_public_programs_give_these_values(variant: str) -> None:
    *values, digit = PUBLIC[variant]
    for name, value in zip(("astronaut", "coffee"), values, strict=True):
        found = score(np.float32(picture(name)) / np.float32(255), variant)
        assert found.value == pytest.approx(value, abs=digit * 0.51)
        assert found.coverage == 1


def test_matlab_gives_the_scores_that_u45_publishes() -> None:
    for row in u45_rows():
        assert score(read_rgb(row.path), "matlab").value == pytest.approx(
            row.uciqe, abs=1e-4
        ), row.path


# -- variants of which no public value is known, written out in float64 over all pixels, without a palette ----------


def reference(image: Bytes, variant: str) -> float:
    """The formula of a variant over pixels (H, W, 3), by libraries and sorts."""
    import cv2
    from skimage.color import rgb2lab

    pixels = image.reshape(-1, 3)
    if variant in ("hue-bgr", "hsv-bytes"):
        given = np.ascontiguousarray(pixels[:, ::-1] if variant == "hue-bgr" else pixels)[None]
        H, S, V = cv2.cvtColor(given, cv2.COLOR_RGB2HSV)[0].astype(float).T
        V.sort()
        one_percent = max(len(pixels) // 100, 1)
        bright, dark = V[-one_percent:].mean(), V[:one_percent].mean()
        if variant == "hsv-bytes":
            return 0.4680 * H.std() + 0.2745 * bright + 0.2576 * S.mean()
        contrast = (bright - dark) / 255
        return 0.4680 * H.std() / 180 + 0.2745 * contrast + 0.2575 * S.mean() / 255
    if variant == "range-contrast":
        L, a, b = cv2.cvtColor(pixels[None], cv2.COLOR_RGB2LAB).reshape(-1, 3).T / 255
    else:
        L, a, b = rgb2lab(pixels[None].astype(float) / 255).reshape(-1, 3).T
    c, ordered = np.sqrt(a**2 + b**2), np.sort(L)
    n = max(round(0.01 * L.size), 1)
    if variant == "range-contrast":
        contrast = np.diff(np.percentile(L, [1, 99]))[0] / np.ptp(L)
        spread = np.sqrt(np.abs(1 - (c.mean() / c) ** 2).mean())
        saturation = c / np.sqrt(c**2 + L**2)
    elif variant == "hsv":
        contrast, spread = np.ptp(L), c.std()
        top, bottom = pixels.max(axis=1).astype(float), pixels.min(axis=1)
        saturation = (top - bottom) / np.maximum(top, 1e-9)
    else:
        contrast, spread = ordered[::-1][::n].mean() - ordered[::n].mean(), c.std()
        saturation = c / np.maximum(L, 1e-9)
    return float(0.4680 * spread + 0.2745 * contrast + 0.2576 * saturation.mean())


@pytest.mark.parametrize("variant", sorted({*VARIANTS} - {*PUBLIC}))
def test_sums_over_the_palette_are_sums_over_the_pixels(variant: str) -> None:
    for image in (picture("coffee")[:, :301], picture("astronaut")):
        assert score(np.float32(image) / np.float32(255), variant).value == pytest.approx(
            reference(image, variant), rel=1e-10
        )


# 8-bit Lab of gray 119 is L = 128 (50.03 in CIE), a = b = 128: c = 128 sqrt(2) with the offset kept, 0 without.
C = 128 * 2**0.5


@pytest.mark.parametrize(("tails", "contrast"), [(1, 0.0), (2, 1.0)])
def test_matlabs_limits_are_levels_that_more_than_one_percent_reach(
    tails: int, contrast: float
) -> None:
    gray = np.repeat([0, 119, 255], [tails, 100 - 2 * tails, tails])
    levels = np.repeat([0, 128, 255], [tails, 100 - 2 * tails, tails])  # L in 8 bits
    saturation = (C / np.hypot(C, levels)).mean()
    assert of(np.repeat(gray[:, None], 3, axis=1).astype(np.uint8), "matlab") == pytest.approx(
        0.2745 * contrast + 0.2576 * saturation
    )


@pytest.mark.parametrize("variant", VARIANTS)
def test_holes_are_left_out_of_every_term(variant: str) -> None:
    rng = np.random.default_rng(4)
    shown = (0.2 + 0.5 * rng.random((40, 50, 3)) * [1, 0.5, 0.2]).astype(np.float32)
    given = rng.random((40, 50)) < 0.6
    holed = np.where(given[..., None], shown, np.float32(np.nan))
    found = score(holed, variant)
    alone = shown[given][None]
    assert found.value == pytest.approx(score(alone, variant).value)
    assert (found.n_pixels, found.coverage) == (given.sum(), pytest.approx(given.mean()))
    assert found.value != pytest.approx(score(np.nan_to_num(holed), variant).value, abs=1e-3)
