"""Filters that several methods use, and pyramids: against formulae, brute force and what they promise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage
from support.made_ground import WATERS, make_ground

import sucre_bench as sb
from sucre_bench import Arrays, Scene, View
from sucre_bench.errors import InputError
from sucre_bench.imaging.cielab import from_lab, to_lab
from sucre_bench.imaging.fill import completed_distance
from sucre_bench.imaging.filters import (
    denoised,
    guided_filter,
    stretched_by_weakness,
    stretched_together,
    window_max,
)
from sucre_bench.imaging.resizing import Resizing, resized, split_variant
from sucre_bench.methods.fusion import blended
from sucre_bench.methods.udcp import dark_channel
from sucre_bench.scene import Restoration

RNG = np.random.default_rng(0)
IMAGE = RNG.random((20, 23, 3)).astype(np.float32)
PLANE = RNG.random((20, 23)).astype(np.float32)


def guided_by_hand(guide: np.ndarray, plane: np.ndarray, radius: int, eps: float) -> np.ndarray:
    """Equations 5-8 of He et al. in float64, in windows that are cut at the border."""

    def mean(x: np.ndarray) -> np.ndarray:
        sides = (2 * radius + 1, 2 * radius + 1, *[1] * (x.ndim - 2))
        total, share = (
            ndimage.uniform_filter(one, sides, mode="constant") for one in (x, np.ones_like(x))
        )
        return total / share

    I = guide.reshape(*plane.shape, -1).astype(np.float64)
    p = plane[..., None].astype(np.float64)
    product = I[..., None] * I[..., None, :]
    covariance = mean(product) - mean(I)[..., None] * mean(I)[..., None, :]
    cross = mean(I * p) - mean(I) * mean(p)
    regularised = covariance + eps * np.eye(I.shape[-1])
    slope = np.linalg.solve(regularised, cross[..., None])[..., 0]
    offset = mean(p) - (slope * mean(I)).sum(axis=-1, keepdims=True)
    return (mean(slope) * I + mean(offset) / I.shape[-1]).sum(axis=-1)


@pytest.mark.parametrize("guide", [IMAGE, IMAGE[..., 1]], ids=["colour", "gray"])
@pytest.mark.parametrize("eps", [1e-2, 1e-4])
def test_the_guided_filter_is_the_least_squares_of_its_paper(guide: np.ndarray, eps: float):
    np.testing.assert_allclose(
        guided_filter(guide, PLANE, 3, eps), guided_by_hand(guide, PLANE, 3, eps), atol=2e-5
    )


def test_the_dark_channel_is_the_least_value_around():
    least = ndimage.minimum_filter(IMAGE[..., 1:].min(axis=-1), 5)
    np.testing.assert_array_equal(dark_channel(IMAGE[..., 1:], 5), least)
    np.testing.assert_array_equal(window_max(PLANE, 5), ndimage.maximum_filter(PLANE, 5))


def test_lab_is_that_of_the_standard():
    """Red, green, blue and mid gray of sRGB, D65 (Lindbloom)."""
    rgb = np.float32([[[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0.5]]])
    expected = [
        [53.24, 80.09, 67.20],
        [87.73, -86.18, 83.18],
        [32.30, 79.19, -107.86],
        [53.39, 0, 0],
    ]
    np.testing.assert_allclose(to_lab(rgb)[0], expected, atol=0.3)
    np.testing.assert_allclose(from_lab(to_lab(IMAGE)), IMAGE, atol=3e-3)


@pytest.mark.parametrize("percent", [0, 5])
def test_a_common_stretch_has_one_gain_and_one_offset_for_all_channels(percent: float):
    image = np.float32(0.2) + np.float32(0.3) * IMAGE * np.float32([0.5, 1, 0.7])
    low, high = np.percentile(image, [percent, 100 - percent])
    expected = ((image - low) / (high - low)).clip(0, 1)
    np.testing.assert_allclose(stretched_together(image, percent), expected, atol=1e-6)
    flat = np.full((4, 5, 3), 0.3, np.float32)
    np.testing.assert_array_equal(stretched_together(flat, percent), flat)


def test_the_weaker_a_channel_the_more_of_it_the_stretch_cuts():
    ramp = np.linspace(0.2, 0.6, 1000, dtype=np.float32).reshape(20, 50)
    rgb = np.stack([ramp / 10, ramp, ramp], axis=-1)
    balanced = stretched_by_weakness(rgb)
    for c, cut in ((0, 0.05), (1, 0.005)):  # red is ten times weaker
        # The k-th smallest of 1000 is the quantile (k - .5) / 1000: .05 is between the 50th and the 51st.
        bottom, top = (
            np.interp(q * 1000, np.arange(1000) + 0.5, rgb[..., c].ravel())
            for q in (cut, 1 - cut)
        )
        expected = ((rgb[..., c].astype(np.float64) - bottom) / (top - bottom)).clip(0, 1)
        np.testing.assert_allclose(balanced[..., c], expected, atol=1e-5)


def test_the_stretch_by_weakness_neither_inverts_a_channel_that_is_almost_black_nor_divides_by_one_that_is():
    rgb = IMAGE * np.float32([0.001, 0, 1])
    balanced = stretched_by_weakness(rgb)
    assert np.isfinite(balanced).all()
    assert np.corrcoef(balanced[..., 0].ravel(), rgb[..., 0].ravel())[0, 1] > 0.5
    assert balanced[..., 0].min() == 0
    assert balanced[..., 0].max() == 1
    assert (balanced[..., 1] == 0).all()


def test_noise_below_its_limit_is_taken_out_and_an_edge_above_it_kept():
    edge = np.where(np.arange(23) < 11, 0.2, 0.8)[None, :, None]
    noisy = (edge + RNG.normal(0, 0.02, IMAGE.shape)).astype(np.float32)
    found = denoised(noisy, 0.1)
    assert found[:, :10].std() < 0.6 * noisy[:, :10].std()
    assert found[:, 12].mean() - found[:, 10].mean() > 0.55
    assert denoised(noisy, 0) is noisy


SIZES = [(61, 47), (48, 64), (33, 2), (4, 6), (1, 1), (1, 9)]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("levels", [1, 3, 9])
def test_with_constant_weights_it_is_the_weighted_mean(size: tuple[int, int], levels: int):
    inputs = RNG.random((3, *size, 3), dtype=np.float32)
    shares = [0.2, 0.5, 0.3]
    weights = [np.full(size, share, np.float32) for share in shares]
    expected = sum(
        share * image.astype(np.float64) for share, image in zip(shares, inputs, strict=True)
    )
    np.testing.assert_allclose(blended(inputs, weights, levels), expected, atol=2e-6)


HEIGHT = 90
WIDTH = 120
V, U = np.mgrid[:HEIGHT, :WIDTH] + 0.5


def test_a_hole_in_a_plane_gets_the_planes_distances() -> None:
    plane = (6 / (1 + V / HEIGHT + 0.3 * U / WIDTH)).astype(np.float32)
    z = plane.copy()
    z[20:60, 30:80] = 0
    found = completed_distance(z, np.full((HEIGHT, WIDTH, 3), 0.5, np.float32))
    np.testing.assert_allclose(found, plane, rtol=0.02)
    assert (found[z > 0] == z[z > 0]).all()


def test_a_step_of_depth_lies_at_the_edge_of_the_image() -> None:
    near = U < 60
    guide = np.where(near[..., None], [0.7, 0.4, 0.3], [0.1, 0.4, 0.5]).astype(np.float32)
    truth = np.where(near, 2.0, 8.0).astype(np.float32)
    z = truth.copy()
    z[10:80, 35:85] = 0  # the hole reaches over the edge
    found = completed_distance(z, guide)
    away = np.abs(U - 60) > 3
    np.testing.assert_allclose(found[away], truth[away], rtol=0.1)


def test_nothing_is_nearer_or_farther_than_what_is_known_around_a_hole() -> None:
    rng = np.random.default_rng(0)
    z = np.where(V > 45, 9 - V / 15, 0).astype(np.float32)  # above the horizon nothing is known
    found = completed_distance(z, rng.random((HEIGHT, WIDTH, 3)).astype(np.float32))
    assert found.min() >= z[z > 0].min() * (1 - 1e-6)
    assert found.max() <= z.max() * (1 + 1e-6)
    assert found[:40].min() > 5, (
        "water above the ground is as far as the farthest ground below it"
    )


def scene() -> Scene:
    """One view of a ground in known water, with a hole in its depth map."""
    made = make_ground(WATERS["coast"], heights_m=(3.0,), noise=0)
    (view,) = made.views
    depth = view.depth.copy()
    depth[30:50, 40:70] = 0
    return replace(made, views=[replace(view, pixels=Arrays(view.rgb, depth, view.reference))])


@pytest.mark.parametrize(
    "method",
    [
        "sucre",
        "sucre_plus",
        "sucre_paper",
        "seathru",
        "gaussian_seathru",
        "stitching",
        "dive_gray_world",
    ],
)
def test_every_method_that_needs_depth_fills_and_leaves_the_rest_as_it_is(method: str) -> None:
    made = scene()
    view = made[0]
    options = {
        "sucre": {"water": "truth"},
        "sucre_plus": {"water": "truth"},
        "sucre_paper": {"steps": 3},
    }.get(method, {})
    plain, filled = (
        sb.restore(method, made, view, fill=fill, **options) for fill in (False, True)
    )
    holes = view.depth == 0
    assert plain.filled is None
    assert filled.filled is not None
    np.testing.assert_array_equal(filled.image, plain.image)
    np.testing.assert_array_equal(filled.valid, ~holes)
    np.testing.assert_array_equal(np.isfinite(filled.filled).all(axis=-1), holes)
    assert np.isfinite(filled.picture).all()
    np.testing.assert_array_equal(filled.picture[~holes], plain.shown[~holes])
    rows = [sb.score(one, view, metrics=["psnr", "coverage"]) for one in (plain, filled)]
    a, b = (
        row.loc[row["metric"].isin(["psnr", "coverage"]), "value"].to_numpy() for row in rows
    )
    np.testing.assert_array_equal(a, b)


def test_filled_pixels_have_their_own_colour_in_the_same_water_and_less_confidence() -> None:
    made = scene()
    holes = made[0].depth == 0
    result = sb.restore("sucre", made, 0, water="truth", fill=True)
    np.testing.assert_allclose(result.filled[holes], made[0].reference[holes], atol=0.06)
    known = np.isfinite(result.confidence) & ~holes
    assert np.isfinite(result.confidence[holes]).all()
    assert not known.any() or np.median(result.confidence[holes]) > np.median(
        result.confidence[known]
    )


BYTES = np.random.default_rng(0).integers(0, 256, (96, 128, 3), np.uint8)
PICTURE = BYTES.astype(np.float32) / 255


def psnr(form: str, image: np.ndarray = PICTURE, *, truth: np.ndarray) -> float:
    rows = sb.score(
        Restoration(image), View("a.png", Arrays(image, None, truth)), [f"psnr:unmasked{form}"]
    )
    return float(rows[rows["metric"] == "psnr"]["value"].item())


def test_forms_are_those_of_papers() -> None:
    """Against the formulas themselves: of shaved edges, MATLAB's Y, a range of 2, torchvision's normalize."""
    truth = np.roll(PICTURE, 1, axis=1)
    assert psnr("@crop4", truth=truth) == pytest.approx(
        psnr("", PICTURE[4:-4, 4:-4], truth=truth[4:-4, 4:-4])
    )
    y = [
        (16 + 65.481 * x[..., 0] + 128.553 * x[..., 1] + 24.966 * x[..., 2]) / 255
        for x in (PICTURE, truth)
    ]
    assert psnr("@y", truth=truth) == pytest.approx(
        -10 * np.log10(np.mean((y[0] - y[1]) ** 2)), abs=1e-3
    )
    assert psnr("@range2", truth=truth) == pytest.approx(
        psnr("", truth=truth) + 20 * np.log10(2)
    )
    dull = np.rint((0.2 + 0.5 * PICTURE) * 255).astype(np.float32) / 255
    assert psnr("@minmax", dull, truth=PICTURE) > 45 > psnr("", dull, truth=PICTURE)


@pytest.mark.parametrize(
    "text",
    ["funie@", "funie@0", "funie@256x256", "funie@256-lanczos", "funie@-256", "funie@crop"],
)
def test_other_sizes_are_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"^variant '"):
        split_variant(text)


def test_the_filters_are_those_of_the_packages() -> None:
    import cv2
    from PIL import Image

    bicubic = np.asarray(Image.fromarray(BYTES).resize((50, 50), Image.Resampling.BICUBIC))
    np.testing.assert_array_equal(resized(BYTES, Resizing(50)), bicubic)
    bilinear = cv2.resize(BYTES, (50, 50), interpolation=cv2.INTER_LINEAR)
    np.testing.assert_array_equal(resized(BYTES, Resizing(50, "bilinear")), bilinear)
    nearest = np.asarray(Image.fromarray(BYTES).resize((50, 50), Image.Resampling.NEAREST))
    np.testing.assert_array_equal(resized(BYTES, Resizing(50, "nearest")), nearest)


def test_a_score_at_256_is_that_of_the_pictures_resized_in_8_bits() -> None:
    reference = np.roll(PICTURE, 1, axis=1)
    small = (
        resized((x * 255 + 0.5).astype(np.uint8), Resizing(48)) / np.float32(255)
        for x in (PICTURE, reference)
    )
    image, truth = small
    named = sb.score(
        Restoration(PICTURE),
        View("a.png", Arrays(PICTURE, None, reference)),
        ["psnr:masked@48"],
    )
    by_hand = sb.score(
        Restoration(image), View("a.png", Arrays(image, None, truth)), ["psnr:masked"]
    )
    (found,), (expected,) = (
        rows[rows["metric"] == "psnr"].to_dict("records") for rows in (named, by_hand)
    )
    assert found["variant"] == "masked@48"
    assert found["value"] == pytest.approx(expected["value"])
    assert found["n_pixels"] == 48 * 48


def test_holes_are_black_at_another_size_and_coverage_is_the_share_that_has_a_colour() -> None:
    holed = PICTURE.copy()
    holed[:24] = np.nan
    rows = sb.score(
        Restoration(holed),
        View("a.png", Arrays(PICTURE, None, PICTURE)),
        ["ssim:uniform7@64", "uiqm:all@64"],
    )
    rows = rows[rows["variant"].str.contains("@")]
    assert len(rows) > 10
    ok = rows[rows["status"] == "ok"]
    assert (ok["coverage"] <= 0.75).all()
    assert ok[ok["variant"] == "funie@64"]["coverage"].item() == pytest.approx(0.75)


def test_what_needs_more_than_pictures_is_refused() -> None:
    with pytest.raises(InputError, match=r"^psi:colour@256: .*charts"):
        sb.score(Restoration(PICTURE), View("a.png", Arrays(PICTURE)), ["psi:colour@256"])
