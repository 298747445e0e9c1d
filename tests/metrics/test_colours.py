"""colours and colours_de00: the display and the exposure do not count, a cast and haze do."""

import numpy as np
import pytest
from skimage.color import deltaE_ciede2000, rgb2lab

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError
from sucre_bench.metrics.colours import Colours, ColoursDe00
from sucre_bench.scene import Arrays, Restoration, Score, View

pytestmark = pytest.mark.short
COLOURS = Colours()
RNG = np.random.default_rng(5)
TRUE = RNG.uniform(0.1, 0.9, (30, 40, 3)).astype(np.float32)
NOISY = (TRUE + RNG.normal(0, 0.05, TRUE.shape)).astype(np.float32)


def score(
    image: Array, metric: Colours | ColoursDe00 = COLOURS, variant: str = "gain", **view: Array
) -> Score:
    view = {"reference": TRUE, **view}
    (found,) = metric.score(
        Restoration(image),
        np.zeros_like(image),
        View("a.png", Arrays(TRUE * 0, **view)),
        variant,
    )
    return found


def test_the_score_is_the_best_psnr_of_any_exposure() -> None:
    tried = [
        -10 * np.log10(np.mean((gain * NOISY.astype(float) - TRUE) ** 2))
        for gain in np.linspace(0.9, 1.1, 2001)
    ]
    assert score(NOISY).value == pytest.approx(max(tried), abs=1e-4)
    assert score(NOISY * np.float32(0.3)).value == pytest.approx(max(tried), abs=1e-4)
    assert score(TRUE).value == np.inf
    assert score(NOISY, variant="raw").value == pytest.approx(
        -10 * np.log10(np.mean((NOISY - TRUE) ** 2)), abs=1e-4
    )
    assert score(NOISY * np.float32(0.3), variant="raw").value < 12


def test_a_cast_counts_unless_the_white_balance_is_free_and_haze_always_counts() -> None:
    cast, hazy = TRUE * np.float32([1, 0.6, 0.3]), TRUE * np.float32(0.5) + np.float32(0.3)
    assert score(cast).value < 20 < 100 < score(cast, variant="channels").value
    assert max(score(hazy).value, score(hazy, variant="channels").value) < 20
    assert (
        score(cast, ColoursDe00()).value
        > 10
        > 1e-3
        > score(TRUE * np.float32(0.3), ColoursDe00()).value
    )


def test_only_pixels_with_a_colour_and_depth_count() -> None:
    holed = NOISY.copy()
    holed[:10] = np.nan
    depth = np.ones((30, 40), np.float32)
    depth[:, :20] = 0
    found = score(holed, depth=depth)
    part, true = (picture[10:, 20:].astype(float) for picture in (NOISY, TRUE))
    gain = (part * true).sum() / (part**2).sum()
    assert found.value == pytest.approx(
        -10 * np.log10(np.mean((gain * part - true) ** 2)), abs=1e-9
    )
    assert (found.n_pixels, found.coverage) == (400, 1 / 3)


def test_de00_is_that_of_scikit_image_after_the_gain() -> None:
    gain = (NOISY.astype(float) * TRUE).sum() / (NOISY.astype(float) ** 2).sum()
    labs = [
        rgb2lab(picture, illuminant="D65")
        for picture in ((gain * NOISY).clip(0, 1), TRUE.astype(float))
    ]
    # Lab under D50, adapted, is nearly that under D65.
    assert score(NOISY, ColoursDe00()).value == pytest.approx(
        deltaE_ciede2000(*labs).mean(), rel=0.03
    )


def test_a_picture_of_another_size_than_the_reference_is_refused() -> None:
    with pytest.raises(InputError, match="40x30"):
        score(TRUE[:20])
