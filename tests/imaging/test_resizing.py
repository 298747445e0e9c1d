"""Scores at another size: the names of variants, the filters, and what the rows say."""

import numpy as np
import pytest

import sucre_bench as sb
from sucre_bench.errors import InputError
from sucre_bench.imaging.encoding import srgb_decode
from sucre_bench.imaging.resizing import Form, Resizing, resized, split_variant
from sucre_bench.scene import Arrays, Restoration, View

BYTES = np.random.default_rng(0).integers(0, 256, (96, 128, 3), np.uint8)
PICTURE = BYTES.astype(np.float32) / 255


@pytest.mark.parametrize(
    ("text", "name", "form"),
    [
        ("funie", "funie", None),
        ("funie@256", "funie", Form(Resizing(256, "bicubic"))),
        ("all@64-bilinear", "all", Form(Resizing(64, "bilinear"))),
        ("gray-unmasked@100-nearest@crop4@y", "gray-unmasked", Form(Resizing(100, "nearest"), 4, "y")),
    ],
)
def test_a_variant_says_its_form(text: str, name: str, form: Form | None) -> None:
    assert split_variant(text) == (name, form)


def psnr(form: str, image: np.ndarray = PICTURE, *, truth: np.ndarray) -> float:
    rows = sb.score(Restoration(image), View("a.png", Arrays(image, None, truth)), [f"psnr:unmasked{form}"])
    return float(rows[rows["metric"] == "psnr"]["value"].item())


def test_forms_are_those_of_papers() -> None:
    """Against the formulas themselves: of shaved edges, MATLAB's Y, a range of 2, torchvision's normalize."""
    truth = np.roll(PICTURE, 1, axis=1)
    assert psnr("@crop4", truth=truth) == pytest.approx(psnr("", PICTURE[4:-4, 4:-4], truth=truth[4:-4, 4:-4]))
    y = [(16 + 65.481 * x[..., 0] + 128.553 * x[..., 1] + 24.966 * x[..., 2]) / 255 for x in (PICTURE, truth)]
    assert psnr("@y", truth=truth) == pytest.approx(-10 * np.log10(np.mean((y[0] - y[1]) ** 2)), abs=1e-3)
    assert psnr("@range2", truth=truth) == pytest.approx(psnr("", truth=truth) + 20 * np.log10(2))
    dull = np.rint((0.2 + 0.5 * PICTURE) * 255).astype(np.float32) / 255
    assert psnr("@minmax", dull, truth=PICTURE) > 45 > psnr("", dull, truth=PICTURE)


@pytest.mark.parametrize(
    "text", ["funie@", "funie@0", "funie@256x256", "funie@256-lanczos", "funie@-256", "funie@crop"]
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
    small = (resized((x * 255 + 0.5).astype(np.uint8), Resizing(48)) / np.float32(255) for x in (PICTURE, reference))
    image, truth = small
    named = sb.score(Restoration(PICTURE), View("a.png", Arrays(PICTURE, None, reference)), ["psnr:masked@48"])
    by_hand = sb.score(Restoration(image), View("a.png", Arrays(image, None, truth)), ["psnr:masked"])
    (found,), (expected,) = (rows[rows["metric"] == "psnr"].to_dict("records") for rows in (named, by_hand))
    assert found["variant"] == "masked@48"
    assert found["value"] == pytest.approx(expected["value"])
    assert found["n_pixels"] == 48 * 48


def test_holes_are_black_at_another_size_and_coverage_is_the_share_that_has_a_colour() -> None:
    holed = PICTURE.copy()
    holed[:24] = np.nan
    rows = sb.score(
        Restoration(holed), View("a.png", Arrays(PICTURE, None, PICTURE)), ["ssim:uniform7@64", "uiqm:all@64"]
    )
    rows = rows[rows["variant"].str.contains("@")]
    assert len(rows) > 10
    ok = rows[rows["status"] == "ok"]
    assert (ok["coverage"] <= 0.75).all()
    assert ok[ok["variant"] == "funie@64"]["coverage"].item() == pytest.approx(0.75)


def test_a_linear_restoration_is_compared_as_it_is_shown() -> None:
    linear = srgb_decode(PICTURE).astype(np.float32)
    view = View("a.exr", Arrays(linear, None, linear), encoding="linear")
    rows = sb.score(Restoration(linear), view, ["psnr:raw@64", "psnr:masked@64"]).query("metric == 'psnr'")
    assert (rows["value"] > 45).all()  # but for rounding to 8 bits


def test_what_needs_more_than_pictures_is_refused() -> None:
    with pytest.raises(InputError, match=r"^psi:colour@256: .*charts"):
        sb.score(Restoration(PICTURE), View("a.png", Arrays(PICTURE)), ["psi:colour@256"])
