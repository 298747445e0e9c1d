"""psnr and ssim: against the definitions written out in float64, and what holes and masks may and may not do."""

from typing import Any

import numpy as np
import pytest
from scipy.ndimage import binary_erosion, gaussian_filter

from sucre_bench.arrays import Array, Mask
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.metrics.colours import Colours, ColoursDe00
from sucre_bench.metrics.similarity import Psnr, Ssim
from sucre_bench.scene import Arrays, Restoration, Score, View

RNG = np.random.default_rng(3)
REFERENCE = RNG.random((40, 50, 3)).astype(np.float32)
SHOWN = (REFERENCE * 0.7 + RNG.random((40, 50, 3)) * 0.3).astype(np.float32)


def score(
    metric: Psnr | Ssim,
    variant: str,
    shown: Array = SHOWN,
    reference: Array | None = REFERENCE,
    depth: Array | None = None,
    raw: Array | None = None,
) -> Score:
    view = View("a.png", Arrays(np.zeros_like(shown), depth, reference))
    (found,) = metric.score(Restoration(shown if raw is None else raw), shown, view, variant)
    return found


def holed(mask: Mask) -> Array:
    shown = SHOWN.copy()
    shown[~mask] = np.nan
    return shown


def test_psnr_is_over_pixels_with_a_colour_and_depth_only() -> None:
    given = RNG.random((40, 50)) < 0.7
    depth = np.where(RNG.random((40, 50)) < 0.6, 2.0, 0).astype(np.float32)
    found = score(Psnr(), "masked", holed(given), depth=depth)
    both = given & (depth > 0)
    truth = -10 * np.log10(np.mean((SHOWN.astype(float) - REFERENCE)[both] ** 2))
    assert found.value == pytest.approx(truth, abs=1e-6)
    assert (found.n_pixels, found.coverage) == (both.sum(), both.mean())


def test_unmasked_psnr_takes_every_pixel_and_holes_as_black() -> None:
    given = RNG.random((40, 50)) < 0.7
    found = score(Psnr(), "unmasked", holed(given), depth=np.zeros((40, 50), np.float32))
    black = np.where(given[..., None], SHOWN, np.float32(0))
    assert found.value == score(Psnr(), "unmasked", black).value
    assert found.coverage == 1


def test_raw_psnr_is_of_the_computed_image_unclipped() -> None:
    raw = SHOWN * 3 - 1
    truth = -10 * np.log10(np.mean((raw.astype(float) - REFERENCE) ** 2))
    assert score(Psnr(), "raw", raw=raw).value == pytest.approx(truth, abs=1e-7)
    assert score(Psnr(), "masked", raw=raw).value > truth + 3


def test_a_linear_reference_is_encoded_like_the_picture_and_left_alone_for_raw() -> None:
    linear = srgb_decode(REFERENCE).astype(np.float32)
    view = View("a.exr", Arrays(linear, reference=linear), encoding="linear")
    shown = srgb_encode(linear).astype(np.float32)
    for metric, variant in [(Psnr(), "masked"), (Psnr(), "raw")]:
        (found,) = metric.score(Restoration(linear), shown, view, variant)
        assert found.value > 100
    (found,) = Ssim().score(Restoration(linear), shown, view, "gaussian")
    assert found.value == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize(
    "variant", [name for name in Ssim.__plugin__.variants if name != "funie"]
)
def test_ssim_is_that_of_scikit_image_in_float64_over_windows_without_a_hole(
    variant: str,
) -> None:
    """Of pictures that are dark and smooth in part, where float32 would lose the variances."""
    from skimage.metrics import structural_similarity

    slope = np.linspace(0, 1, 300)[:, None, None] * np.array([0.02, 0.4, 1])
    reference = (slope + 0.001 * RNG.random((300, 700, 3))).clip(0, 1).astype(np.float32)
    shown = (0.9 * reference + 0.0005 * RNG.random((300, 700, 3))).astype(np.float32)
    given = np.ones((300, 700), bool)
    given[30:33, 12:15] = given[5, 44] = given[-1, 300] = False
    shown[~given] = np.nan
    x, y = np.nan_to_num(shown, nan=0.0).astype(float), reference.astype(float)
    if "gray" in variant:
        x, y = ((z @ [0.299, 0.587, 0.114])[..., None] for z in (x, y))
    published = {"gaussian_weights": True, "use_sample_covariance": False}
    side, window = (7, {"win_size": 7}) if "uniform7" in variant else (11, published)
    _, full = structural_similarity(x, y, data_range=1, channel_axis=-1, full=True, **window)
    mask = np.ones_like(given) if "unmasked" in variant else given
    whole = binary_erosion(mask, np.ones((side, side)))
    found = score(Ssim(), variant, shown, reference)
    assert found.value == pytest.approx(full[whole].mean(), rel=1e-6)
    assert (found.n_pixels, found.coverage) == (whole.sum(), whole.mean())


def test_ssim_of_funie_gan_has_the_windows_of_scipy_beyond_the_borders() -> None:
    x, y = ((RNG.random((256, 256, 3)) * 255).astype(np.uint8) for _ in range(2))
    truth = []
    for a, b in ((x[..., k].astype(float), y[..., k].astype(float)) for k in range(3)):
        ma, mb, aa, bb, ab = (gaussian_filter(z, 1.5) for z in (a, b, a * a, b * b, a * b))
        va, vb, cov = (
            25 / 24 * (z - w) for z, w in ((aa, ma * ma), (bb, mb * mb), (ab, ma * mb))
        )
        c1 = 2.55**2
        c2 = 7.65**2
        truth.append(
            np.mean(
                (2 * ma * mb + c1) * (2 * cov + c2) / ((ma**2 + mb**2 + c1) * (va + vb + c2))
            )
        )
    found = score(Ssim(), "funie", (x / 255).astype(np.float32), (y / 255).astype(np.float32))
    assert found.value == pytest.approx(np.mean(truth), abs=1e-5)


def test_what_is_in_a_hole_of_the_reference_or_outside_the_depth_moves_no_masked_score() -> (
    None
):
    depth = np.ones((40, 50), np.float32)
    depth[:12] = 0
    reference = REFERENCE.copy()
    reference[30:, 40:] = np.nan
    other = SHOWN.copy()
    other[:12] = 0.1
    other[30:, 40:] = 0.9
    for metric in (Psnr(), Ssim()):
        variant = metric.__plugin__.default[0]
        first, second = (
            score(metric, variant, image, reference, depth) for image in (SHOWN, other)
        )
        assert first == second
        assert 0 < first.coverage < 0.7


@pytest.mark.parametrize("metric", [Psnr(), Ssim()])
def test_nothing_restored_is_nan_with_coverage_0(metric: Psnr | Ssim) -> None:
    found = score(metric, metric.__plugin__.default[0], np.full_like(SHOWN, np.nan))
    assert np.isnan(found.value)
    assert (found.n_pixels, found.coverage) == (0, 0)


@pytest.mark.parametrize("metric", [Psnr(), Ssim(), Colours(), ColoursDe00()])
def test_a_view_without_a_reference_has_no_score(metric: Any) -> None:
    view = View("a.png", Arrays(SHOWN))
    variant = metric.__plugin__.default[0]
    assert not list(metric.score(Restoration(SHOWN), SHOWN, view, variant))


def test_luma_is_compared_in_whole_levels_of_8_bits() -> None:
    colours = np.array([[[200, 100, 50], [0, 0, 0]]], np.uint8)  # luma 124.2 and 0
    found = score(Psnr(), "luma", np.float32(colours) / 255, np.zeros((1, 2, 3), np.float32))
    assert found.value == pytest.approx(-10 * np.log10((124 / 255) ** 2 / 2))
    assert found.n_pixels == 2


def test_gray_is_of_luma_at_256_by_pillow() -> None:
    from PIL import Image, ImageOps

    levels = []
    for image in (SHOWN, REFERENCE):
        small = Image.fromarray((image * 255 + 0.5).astype(np.uint8)).resize(
            (256, 256), Image.Resampling.BICUBIC
        )
        levels.append(np.asarray(ImageOps.grayscale(small)).astype(float) / 255)
    found = score(Psnr(), "gray")
    assert found.value == pytest.approx(
        -10 * np.log10(np.mean((levels[0] - levels[1]) ** 2)), abs=1e-3
    )
    assert (found.n_pixels, found.coverage) == (256 * 256, 1)
    holed = np.where(np.arange(40)[:, None, None] < 20, np.float32(np.nan), SHOWN)
    assert (
        score(Psnr(), "gray", holed).value == score(Psnr(), "gray", np.nan_to_num(holed)).value
    )
