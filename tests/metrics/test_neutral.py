"""neutral: charts painted in colours whose chroma is known."""

import numpy as np
import pytest
from support.made_scene import TILTED, painted

from sucre_bench.arrays import Array
from sucre_bench.imaging.chart_kinds import chart_kind
from sucre_bench.metrics.chart_colours import Neutral
from sucre_bench.scene import Arrays, Chart, Restoration, Score, View


def scores(shown: Array, kind: str = "dgk") -> dict[str, Score]:
    view = View("a.png", Arrays(shown), charts=[Chart("c", kind, TILTED)])
    return {s.region: s for s in Neutral().score(Restoration(shown), shown, view, "chroma")}


def test_a_picture_of_one_colour_has_that_colours_chroma_in_every_gray_patch() -> None:
    shown = np.empty((300, 420, 3), np.float32)
    shown[:] = (1, 0, 0)  # Lab under D50: 54.29, 80.80, 69.89 (Lindbloom)
    found = scores(shown)
    assert list(found) == ["c", *(f"c/{p.number}-{p.name}" for p in chart_kind("dgk").patches if not p.colour)]
    np.testing.assert_allclose([s.value for s in found.values()], np.hypot(80.80, 69.89), atol=0.06)


def test_grays_of_any_brightness_have_no_chroma_and_colours_do_not_count() -> None:
    shown = painted(chart_kind("dgk"), TILTED)
    is_gray = np.ptp(shown, axis=-1) < 0.03
    shown[is_gray] = shown[is_gray].mean(axis=-1, keepdims=True)
    assert scores(shown)["c"].value == pytest.approx(0, abs=0.05)
    assert scores(shown[..., [2, 0, 1]])["c"].value == pytest.approx(0, abs=0.05)


def test_a_gray_patch_without_a_colour_is_left_out_and_lowers_the_coverage() -> None:
    shown = painted(chart_kind("dgk"), TILTED) * np.float32([0.6, 1, 1])
    whole = scores(shown)
    white = next(region for region in whole if region.endswith("-white"))
    others = [s.value for region, s in whole.items() if region not in ("c", white)]
    shown[np.isclose(shown, [0.6, 1, 1]).all(axis=-1)] = np.nan
    holed = scores(shown)
    assert holed["c"].value == pytest.approx(np.mean(others))
    assert holed["c"].coverage == pytest.approx(5 / 6)
