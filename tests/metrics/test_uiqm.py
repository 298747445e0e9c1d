"""uiqm, uicm, uism, uiconm: published scores, each variant written out block by block in float64, and holes."""

import math

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image
from scipy import ndimage
from support.places import u45_rows

from sucre_bench.arrays import Array
from sucre_bench.errors import NotApplicableError
from sucre_bench.imaging.image_files import read_rgb
from sucre_bench.metrics.uiqm import Uicm, Uiconm, Uiqm, Uism
from sucre_bench.scene import Arrays, Restoration, Score, View

VARIANTS = tuple(Uiqm.__plugin__.variants)
UIQM = Uiqm()
PARTS = (Uicm(), Uism(), Uiconm())
Metric = Uiqm | Uicm | Uism | Uiconm
Bytes = npt.NDArray[np.uint8]


def score(shown: Array, variant: str = "panetta2016", metric: Metric = UIQM) -> Score:
    (found,) = metric.score(Restoration(shown), shown, View("a.png", Arrays(shown)), variant)
    return found


def of(image: Bytes, variant: str = "panetta2016", metric: Metric = UIQM) -> float:
    return score(np.float32(image) / np.float32(255), variant, metric).value


def noise(h: int, w: int, darkest: int = 0) -> Bytes:
    """Smooth patches and noise, with a flat dark corner: every branch of the block measures is met."""
    rng = np.random.default_rng(5)
    image = np.kron(rng.integers(0, 256, (h // 8 + 1, w // 8 + 1, 3)), np.ones((8, 8, 1), int))[
        :h, :w
    ]
    image = np.clip(image + rng.integers(-9, 10, image.shape), 0, 255)
    image[:20, :20] = darkest
    return image.astype(np.uint8)


# -- published scores --------------------------------------------------------------------------------------------


def test_u45s_published_scores_are_those_of_matlab_first_output() -> None:
    for row in u45_rows():
        shown = read_rgb(row.path)
        published = [
            (Uicm(), row.uicm),
            (Uism(), row.uism),
            (Uiconm(), row.uiconm),
            (Uiqm(), row.uiqm),
        ]
        for metric, value in published:
            variant = "matlab" if isinstance(metric, (Uism, Uiconm)) else "matlab-first-output"
            assert score(shown, variant, metric).value == pytest.approx(value, abs=1e-6), (
                row.path,
                metric,
            )


# -- by hand -----------------------------------------------------------------------------------------------------


def test_a_black_block_has_no_score_where_the_public_program_divides_by_zero() -> None:
    image = np.full((33, 40, 3), 90, np.uint8)
    image[:7, :8] = 0
    assert math.isfinite(of(image, "chen"))
    image[7, :8] = 0
    for metric in (Uiqm(), Uiconm()):
        with pytest.raises(NotApplicableError, match=r"a\.png: .*8x8"):
            of(image, "chen", metric)
    assert math.isfinite(of(image, "chen", Uism()))
    image[:] = 90
    image[32:, :8] = 0  # the block that the edge cuts counts, too
    with pytest.raises(NotApplicableError):
        of(image, "chen-bgr")


# -- against the formulas, block by block ------------------------------------------------------------------------


def slow_gradients(plane: Array) -> tuple[Array, Array]:
    """Sobel's filters to the right and down, the edge repeated."""
    return ndimage.sobel(plane, 1, mode="nearest"), ndimage.sobel(plane, 0, mode="nearest")


def slow_enlarged(plane: Array, side: int) -> Array:
    """Cubic convolution (Keys 1981) to the next multiple of side by Pillow, of the image and its reflections."""
    for _ in range(2):
        n = len(plane)
        m = math.ceil(n / side) * side
        mirrored = np.concatenate([plane[::-1], plane, plane[::-1]]).astype(np.float32)
        size = (plane.shape[1], 3 * m)
        large = Image.fromarray(mirrored).resize(size, Image.Resampling.BICUBIC)
        plane = np.asarray(large, np.float64)[m : 2 * m].T
    return plane


def blocks(plane: Array, side: int, partial: bool) -> list[Array]:
    h, w = plane.shape[:2]
    k1, k2 = (math.ceil(h / side), math.ceil(w / side)) if partial else (h // side, w // side)
    return [
        plane[i * side : (i + 1) * side, j * side : (j + 1) * side]
        for i in range(k1)
        for j in range(k2)
    ]


def slow_uicm(image: Bytes, variant: str) -> float:
    if "bgr" in variant:
        image = image[..., ::-1]
    if variant == "uwcnn-plus":
        image = image[..., [1, 0, 2]]
    R, G, B = (image[..., k].ravel() for k in range(3))  # bytes, which wrap around
    if variant not in ("wraparound", "chen", "chen-bgr", "uwcnn-plus"):
        R, G, B = (x.astype(float) for x in (R, G, B))
    means, variances = [], []
    for x in (R - G, (R + G) / 2 - B):
        x = np.sort(x.astype(float))
        low, high, divisor = math.ceil(0.1 * x.size), math.floor(0.1 * x.size), None
        if "matlab" in variant:
            low, high = round(0.1 * x.size), x.size - round(0.9 * x.size)
            divisor = 0.8 * x.size
        kept = x[low : x.size - high]
        mean = kept.sum() / (divisor or kept.size)
        means.append(mean)
        over_kept = variant in ("trimmed-variance", "chen", "chen-bgr", "matlab")
        among = kept if over_kept else x
        variances.append(((among - mean) ** 2).sum() / ((over_kept and divisor) or among.size))
    if variant == "matlab-first-output":
        return means[0]
    return -0.0268 * math.hypot(*means) + 0.1586 * math.sqrt(sum(variances))


def slow_uism(image: Bytes, variant: str) -> float:
    from skimage.filters import sobel

    weights = [
        0.299,
        0.587,
        0.144 if variant.startswith(("blue144", "funie", "getuiqm1")) else 0.114,
    ]
    if "bgr" in variant:
        weights = weights[::-1]
    if variant == "uwcnn-plus":
        weights = [0.557, 0.144, 0.299]
    side = slow_side(variant)
    total = 0.0
    for k, weight in enumerate(weights):
        plane = image[..., k].astype(float)
        right, down = slow_gradients(plane)
        edges = plane * np.hypot(right, down)
        if "chen" in variant:
            edges = np.round(plane * sobel(image[..., k]))
        if "matlab" in variant:
            edges = slow_enlarged(np.abs(right - down), side)
        if variant == "uwcnn-plus":
            edges = plane
        every, found = blocks(edges, side, "chen" in variant), 0j
        for block in every:
            least, most = block.min(), block.max()
            if variant == "uwcnn-plus":
                found += math.log(most / (least or 1) + 1e-5)
            elif variant in ("plus-one", "chen", "chen-bgr"):
                found += math.log((most or 1) / (least or 1))
            elif least != 0 and most != 0:
                found += np.log(complex(most / least))
        count = len(every)
        if variant == "getuiqm1" or "matlab" in variant:
            count = (image.shape[0] / side) * (image.shape[1] / side)
        total += weight * 2 * (abs(found) if "matlab" in variant else found.real) / count
    return total


def slow_side(variant: str) -> int:
    if variant == "block5" or "matlab" in variant:
        return 5
    return 8 if "block8" in variant or variant in ("chen", "chen-bgr", "uwcnn-plus") else 10


def slow_uiconm(image: Bytes, variant: str) -> float:
    x = image.astype(float)
    if "bgr" in variant:
        x = x[..., ::-1]
    if "matlab" in variant:
        found = []
        for k in range(3):
            every = blocks(slow_enlarged(x[..., k], 5), 5, False)
            ms = [
                complex((b.max() - b.min()) / (b.max() + b.min()))
                for b in every
                if b.max() + b.min() != 0
            ]
            found.append(abs(sum(m * np.log(m) for m in ms if m != 0)) / len(every))
        return sum(found)
    side = slow_side(variant)
    levels = 0.299 * x[..., 0] + 0.587 * x[..., 1] + 0.114 * x[..., 2]
    if "chen" in variant:
        levels = (0.2125 * x[..., 0] + 0.7154 * x[..., 1] + 0.0721 * x[..., 2]) / 255
    if variant.startswith(("funie", "getuiqm1", "uwcnn")):
        levels = x
    entropies, every = [], blocks(levels, side, "chen" in variant)
    plain = variant == "no-plip" or variant.startswith(("funie", "getuiqm1"))
    for block in every:
        high, low = block.max(), block.min()
        top, bottom = high - low, high + low
        if not plain:
            top, bottom = 1026 * (high - low) / (1026 - low), high + low - high * low / 1026
        entropies.append(-top / bottom * math.log(top / bottom) if top > 0 else 0.0)
    if plain:
        h, w = image.shape[:2]
        return sum(entropies) / (
            (h / 10) * (w / 10) if variant == "getuiqm1" else len(entropies)
        )
    total = 0.0
    for e in entropies:  # the PLIP sum, or a plain one of the terms as printed
        total = (
            total - e
            if variant in ("chen", "chen-bgr", "uwcnn-plus")
            else total + e - total * e / 1026
        )
    # scaled by the PLIP product
    return 1026 - 1026 * (1 - total / 1026) ** (1 / len(entropies))


@pytest.mark.parametrize("variant", VARIANTS)
def test_each_variant_is_its_formula_written_out_block_by_block(variant: str) -> None:
    image = noise(53, 67, darkest=1 if "chen" in variant else 0)
    parts = slow_uicm(image, variant), slow_uism(image, variant), slow_uiconm(image, variant)
    for metric, expected in zip(PARTS, parts, strict=True):
        if variant in metric.__plugin__.variants:
            # chen's program rounds edges in float64, of which some lie between two numbers
            exact = 1e-3 if "chen" in variant and isinstance(metric, Uism) else 1e-6
            assert of(image, variant, metric) == pytest.approx(expected, rel=exact), metric
    weights = (0.0282, 0.2953, 0.6765 if variant == "uwcnn-plus" else 3.5753)
    assert of(image, variant) == pytest.approx(
        np.dot(weights, parts), rel=1e-3 if "chen" in variant else 1e-6
    )


# -- holes -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("variant", VARIANTS)
def test_only_blocks_without_a_hole_in_or_beside_them_count(variant: str) -> None:
    image = noise(40, 80, darkest=1)
    shown = np.float32(image) / np.float32(255)
    shown[:, 40:] = np.nan
    side = slow_side(variant)
    found = score(shown, variant)
    columns = 40 // side - 1  # the last column of blocks on the left has holes for neighbours
    assert found.coverage == pytest.approx(columns * side / 80)
    assert found.n_pixels == 1600
    other = shown.copy()
    other[20, 20] = np.nan
    assert score(other, variant).coverage < found.coverage


@pytest.mark.parametrize("variant", VARIANTS)
def test_what_a_pixel_without_a_colour_still_holds_moves_nothing(variant: str) -> None:
    """Of a picture enlarged to a multiple of 5, too: 63 columns become 65."""
    shown = np.float32(noise(61, 63, darkest=1)) / np.float32(255)
    shown[30:40, 30:40, 0] = np.nan  # red alone
    other = shown.copy()
    other[30:40, 30:40, 1:] = 1 - shown[30:40, 30:40, 1:]
    for metric in (Uiqm(), *PARTS):
        if variant in metric.__plugin__.variants:
            assert score(shown, variant, metric) == score(other, variant, metric)


@pytest.mark.parametrize("shape", [(5, 50, 3), (40, 40, 3)])
@pytest.mark.parametrize("variant", ["panetta2016", "matlab"])
def test_a_picture_without_a_whole_block_is_nan_with_coverage_0(
    shape: tuple[int, int, int], variant: str
) -> None:
    shown = np.full(shape, 0.5, np.float32)
    shown[::5, ::5] = np.nan
    for metric in (Uiqm(), Uism(), Uiconm()):
        found = score(shown, variant, metric)
        assert np.isnan(found.value)
        assert found.coverage == 0
