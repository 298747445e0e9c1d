"""uiqm: hand-made pictures, the formulas and two public programs' behaviour written out as slow loops, and holes."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

from sucre_bench.arrays import Array
from sucre_bench.metrics.uiqm import (
    _VARIANTS,
    PANETTA,
    Recipe,
    Uiqm,
    alpha_trimmed_mean,
    eme,
    uicm,
    uiconm,
    uism,
)
from sucre_bench.scene import Arrays, Restoration, Score, View

VARIANTS = tuple(Uiqm.__plugin__.variants)
Image = npt.NDArray[np.uint8]


def score(shown: Array, variant: str = "panetta2016") -> Score:
    (found,) = Uiqm().score(Restoration(shown), shown, View("a.png", Arrays(shown)), variant)
    return found


def of(image: Image, variant: str = "panetta2016") -> float:
    return score(np.float32(image) / np.float32(255), variant).value


def everywhere(image: Image) -> npt.NDArray[np.bool_]:
    return np.ones(image.shape[:2], bool)


def noise(h: int, w: int, seed: int = 5) -> Image:
    """Smooth patches and noise, with some flat black: every branch of the block measures is met."""
    rng = np.random.default_rng(seed)
    image = np.kron(rng.integers(0, 256, (h // 8 + 1, w // 8 + 1, 3)), np.ones((8, 8, 1), int))[:h, :w]
    image = np.clip(image + rng.integers(-9, 10, image.shape), 0, 255)
    image[:20, :20] = 0
    return image.astype(np.uint8)


# -- by hand -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_constant_gray_picture_has_neither_colour_nor_sharpness_nor_contrast(variant: str) -> None:
    # R + G wraps to 144 in a byte: YB = -128 for the two variants that let it
    wraps = -0.0268 * 128 * 0.0282 if variant in ("wraparound", "chen") else 0.0
    assert of(np.full((40, 40, 3), 200, np.uint8), variant) == pytest.approx(wraps, abs=1e-9)


def test_the_trimmed_mean_drops_ceil_low_and_floor_high() -> None:
    assert alpha_trimmed_mean(np.array([100, 1, 2, 3, 4, 5, 6, 7, 8, -50])) == 4.5
    x = np.array([-9.0, -8, 1, 2, 3, 4, 5, 6, 7, 8, 9, 99, 98, 97, 96])  # 15: two low, one high
    assert alpha_trimmed_mean(x) == pytest.approx((1 + 2 + 3 + 4 + 5 + 6 + 7 + 8 + 9 + 98 + 97 + 96) / 12)


def test_colourfulness_of_two_colours_by_hand() -> None:
    pixels = np.array([[200, 100, 50]] * 10 + [[100, 100, 100]] * 10, np.uint8)
    # RG = 100 or 0, YB = 100 or 0: means 50, variances 2500
    assert uicm(pixels) == pytest.approx(-0.0268 * math.hypot(50, 50) + 0.1586 * math.sqrt(5000))


def test_red_below_green_wraps_around_in_that_variant_only() -> None:
    pixels = np.array([[100, 101, 100]] * 20, np.uint8)  # RG = -1 or 255; YB = .5, or 201 / 2 - 100 = .5
    assert uicm(pixels) == pytest.approx(-0.0268 * math.hypot(1, 0.5))
    assert uicm(pixels, Recipe(wraparound=True)) == pytest.approx(-0.0268 * math.hypot(255, 0.5))


def test_eme_by_hand() -> None:
    plane = np.full((10, 20), 2.0)
    plane[3, 3] = 8
    plane[5, 15] = 0  # the second block holds a 0
    whole = np.ones((1, 2), bool)
    assert eme(plane, whole) == pytest.approx(math.log(4))  # 2 / 2 (ln 4 + nothing)
    assert eme(plane, whole, Recipe(zero_is_one=True)) == pytest.approx(math.log(4) + math.log(2))
    assert eme(plane, np.array([[True, False]])) == pytest.approx(2 * math.log(4))


def test_sharpness_of_a_ramp_by_hand() -> None:
    ramp = np.tile(np.arange(10, 30, dtype=np.uint8), (10, 1))
    image = np.stack([ramp] * 3, axis=-1)
    # Sobel is 8 inside and 4 at both ends, times the ramp: 40 to 152 in the left block, 116 to 224 in the right
    expected = math.log(152 / 40) + math.log(224 / 116)
    assert uism(image, everywhere(image)) == pytest.approx(expected, rel=1e-6)
    blue = uism(image, everywhere(image), Recipe(blue=0.144))
    assert blue == pytest.approx(1.03 * expected, rel=1e-6)


def test_contrast_of_two_tones_by_hand() -> None:
    image = np.full((20, 20, 3), 200, np.uint8)
    image[:, :5] = 50  # two of four blocks hold both tones
    m = 150 / 250
    plain = -m * math.log(m) / 2
    assert uiconm(image, everywhere(image), Recipe(contrast="plain")) == pytest.approx(plain)
    assert uiconm(image, everywhere(image), Recipe(contrast="channels")) == pytest.approx(plain)
    m = (1026 * 150 / (1026 - 50)) / (250 - 200 * 50 / 1026)
    assert uiconm(image, everywhere(image)) == pytest.approx(-m * math.log(m) / 2, rel=1e-3)


def test_contrast_does_not_depend_on_the_size_of_the_image_but_for_the_plain_sum() -> None:
    small = noise(40, 40)
    large = np.tile(small, (6, 6, 1))
    for recipe in (PANETTA, Recipe(contrast="plain"), Recipe(contrast="channels")):
        assert uiconm(large, everywhere(large), recipe) == pytest.approx(uiconm(small, everywhere(small), recipe))
    recipe = Recipe(contrast="plip-unit", block=8)
    shrunk = [uiconm(im, everywhere(im), recipe) for im in (small, np.tile(small, (20, 20, 1)))]
    assert shrunk[0] < 0.8 * shrunk[1] < 0


# -- against the formulas, block by block ------------------------------------------------------------------


def slow_sobel(plane: Array) -> Array:
    p = np.pad(plane, 1, mode="symmetric")
    out = np.zeros(plane.shape)
    for i in range(plane.shape[0]):
        for j in range(plane.shape[1]):
            n = p[i : i + 3, j : j + 3]
            dx = n[0, 2] + 2 * n[1, 2] + n[2, 2] - n[0, 0] - 2 * n[1, 0] - n[2, 0]
            dy = n[2, 0] + 2 * n[2, 1] + n[2, 2] - n[0, 0] - 2 * n[0, 1] - n[0, 2]
            out[i, j] = math.hypot(dx, dy)
    return out


def blocks(plane: Array, side: int, partial: bool) -> list[Array]:
    h, w = plane.shape[:2]
    k1, k2 = (math.ceil(h / side), math.ceil(w / side)) if partial else (h // side, w // side)
    return [plane[i * side : (i + 1) * side, j * side : (j + 1) * side] for i in range(k1) for j in range(k2)]


def slow_uicm(image: Array, trimmed_variance: bool) -> float:
    means, variances = [], []
    R, G, B = (image[..., k].ravel() for k in range(3))
    for x in (R - G, (R + G) / 2 - B):
        kept = sorted(x)[math.ceil(0.1 * x.size) : x.size - math.floor(0.1 * x.size)]
        means.append(sum(kept) / len(kept))
        among = kept if trimmed_variance else x
        variances.append(sum((v - means[-1]) ** 2 for v in among) / len(among))
    return -0.0268 * math.hypot(*means) + 0.1586 * math.sqrt(sum(variances))


def slow_eme(plane: Array, side: int, partial: bool, zero_is_one: bool) -> float:
    total, every = 0.0, blocks(plane, side, partial)
    for block in every:
        least, most = block.min(), block.max()
        if zero_is_one:
            total += math.log((most or 1) / (least or 1))
        elif least > 0:
            total += math.log(most / least)
    return 2 * total / len(every)


@pytest.mark.parametrize(
    "variant",
    ["panetta2016", "trimmed-variance", "blue144", "block8", "block5", "no-plip", "plus-one", "funie"],
)
def test_the_total_is_the_published_sum_over_blocks_with_the_named_point_changed(variant: str) -> None:
    image = noise(53, 67)
    x = image.astype(float)
    side = {"block8": 8, "block5": 5}.get(variant, 10)
    blue = 0.144 if variant in ("blue144", "funie") else 0.114
    sharp = sum(
        weight * slow_eme(x[..., k] * slow_sobel(x[..., k]), side, False, variant == "plus-one")
        for k, weight in enumerate((0.299, 0.587, blue))
    )
    entropies = []
    luma = 0.299 * x[..., 0] + 0.587 * x[..., 1] + 0.114 * x[..., 2]
    for block in blocks(x if variant == "funie" else luma, side, False):
        high, low = block.max(), block.min()
        if variant in ("no-plip", "funie"):
            top, bottom = high - low, high + low
        else:
            top, bottom = 1026 * (high - low) / (1026 - low), high + low - high * low / 1026
        entropies.append(-top / bottom * math.log(top / bottom) if top > 0 else 0.0)
    contrast = sum(entropies) / len(entropies)
    if variant not in ("no-plip", "funie"):
        total = 0.0
        for e in entropies:  # the PLIP sum, scaled by the PLIP product
            total = total + e - total * e / 1026
        contrast = 1026 - 1026 * (1 - total / 1026) ** (1 / len(entropies))
    colour = slow_uicm(x, variant == "trimmed-variance")
    assert of(image, variant) == pytest.approx(0.0282 * colour + 0.2953 * sharp + 3.5753 * contrast, rel=1e-5)


def test_chen_is_that_program_written_out() -> None:
    from skimage.color import rgb2gray
    from skimage.filters import sobel

    image = noise(53, 67)
    R, G, B = (image[..., k] for k in range(3))  # bytes: they wrap around
    terms = []
    for opponent in (R - G, (R + G) / 2 - B):
        kept = np.sort(opponent, axis=None)
        cut = int(0.1 * kept.size)
        kept = kept[cut:-cut].astype(float)
        terms.append((kept.mean(), kept.var()))
    (mean_rg, var_rg), (mean_yb, var_yb) = terms
    colour = -0.0268 * math.hypot(mean_rg, mean_yb) + 0.1586 * math.sqrt(var_rg + var_yb)
    sharp = sum(
        weight * slow_eme(np.round(image[..., k] * sobel(image[..., k])), 8, True, True)
        for k, weight in enumerate((0.299, 0.587, 0.114))
    )
    total, every = 0.0, blocks(rgb2gray(image), 8, True)
    for block in every:
        high, low = block.max(), block.min()
        if high > low:
            m = (1026 * (high - low) / (1026 - low)) / (high + low - high * low / 1026)
            total += m * math.log(m)
    contrast = 1026 - 1026 * (1 - total / 1026) ** (1 / len(every))
    expected = 0.0282 * colour + 0.2953 * sharp + 3.5753 * contrast
    assert of(image, "chen") == pytest.approx(expected, rel=1e-3)  # it trims floor, not ceil, of a tenth below


def test_variance_over_all_or_trimmed_pixels_of_a_public_picture() -> None:
    from skimage import data

    pixels = data.astronaut().reshape(-1, 3)
    assert uicm(pixels) == pytest.approx(8.43, abs=0.01)
    assert uicm(pixels, Recipe(trimmed_variance=True)) == pytest.approx(6.48, abs=0.01)


def test_variants_named_for_one_point_differ_from_the_default_in_that_point() -> None:
    ports = {"panetta2016", "funie", "chen"}
    for name, (_, recipe) in _VARIANTS.items():
        changed = [f for f in Recipe.__slots__ if getattr(recipe, f) != getattr(PANETTA, f)]
        assert len(changed) == 1 or name in ports
    image = noise(64, 64)
    assert len({round(of(image, v), 6) for v in VARIANTS}) == len(VARIANTS)


# -- holes -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("variant", VARIANTS)
def test_only_blocks_without_a_hole_in_or_beside_them_count(variant: str) -> None:
    image = noise(40, 80)
    shown = np.float32(image) / np.float32(255)
    shown[:, 40:] = np.nan
    side = _VARIANTS[variant][1].block
    found = score(shown, variant)
    columns = 40 // side - 1  # the last column of blocks on the left has holes for neighbours
    assert found.coverage == pytest.approx(columns * side / 80)
    assert found.n_pixels == 1600
    other = shown.copy()
    other[20, 20] = np.nan
    assert score(other, variant).coverage < found.coverage


def test_what_surrounds_a_hole_adds_no_sharpness_or_contrast() -> None:
    flat = np.full((40, 40, 3), 0.6, np.float32)
    flat[10:20, 10:20] = np.nan
    assert score(flat).value == pytest.approx(0, abs=1e-9)


def test_what_lies_in_a_hole_moves_nothing() -> None:
    image, valid = noise(60, 60), np.ones((60, 60), bool)
    valid[30:40, 30:40] = False
    other = np.where(valid[..., None], image, 255 - image)
    for measure in (uism, uiconm):
        assert measure(other, valid) == measure(image, valid)
        assert measure(other, everywhere(image)) != measure(image, everywhere(image))


@pytest.mark.parametrize("shape", [(5, 50, 3), (40, 40, 3)])
def test_a_picture_without_a_whole_block_is_nan_with_coverage_0(shape: tuple[int, int, int]) -> None:
    shown = np.full(shape, 0.5, np.float32)
    shown[::5, ::5] = np.nan
    found = score(shown)
    assert np.isnan(found.value)
    assert found.coverage == 0
