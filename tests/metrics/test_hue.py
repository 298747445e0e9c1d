"""hue and hue_error: published hues, and charts painted in known ones."""

import numpy as np
import pytest
from support.made_scene import TILTED, painted

from sucre_bench.arrays import Array
from sucre_bench.imaging.chart_kinds import KINDS, chart_kind
from sucre_bench.metrics.chart_colours import Hue, HueError, hue_deg, turn_deg
from sucre_bench.scene import Arrays, Chart, Restoration, Score, View


def scores(metric: Hue | HueError, shown: Array, variant: str, kind: str = "dgk") -> dict[str, Score]:
    view = View("a.png", Arrays(shown), charts=[Chart("c", kind, TILTED)])
    return {s.region: s for s in metric.score(Restoration(shown), shown, view, variant)}


@pytest.mark.parametrize(
    ("rgb", "hue"),
    [
        ((1, 0, 0), 0),
        ((1, 0.5, 0), 30),
        ((1, 1, 0), 60),
        ((0, 0.3, 0), 120),
        ((0.2, 0.6, 0.6), 180),
        ((0, 0, 1), 240),
        ((1, 0.8, 1), 300),
    ],
)
def test_hsv_hue_is_the_angle_on_the_hexagon_whatever_saturation_and_value(rgb: Array, hue: float) -> None:
    assert hue_deg(np.array(rgb, float), "hsv") == pytest.approx(hue, abs=1e-9)


@pytest.mark.parametrize(
    ("rgb", "a", "b"),  # the sRGB primaries in Lab under D50, as in ICC profiles (Lindbloom)
    [((1, 0, 0), 80.80, 69.89), ((0, 1, 0), -79.29, 80.99), ((0, 0, 1), 68.30, -112.03)],
)
def test_lab_hue_is_that_of_the_primaries_under_d50(rgb: Array, a: float, b: float) -> None:
    assert hue_deg(np.array(rgb, float), "lab") == pytest.approx(np.degrees(np.arctan2(b, a)) % 360, abs=0.03)


@pytest.mark.parametrize("form", ["hsv", "lab"])
def test_grays_and_holes_have_no_hue(form: str) -> None:
    assert np.isnan(hue_deg(np.array([[0.5, 0.5, 0.5], [0, 0, 0], [np.nan, np.nan, np.nan]]), form)).all()


def test_a_turn_is_the_shorter_way_round() -> None:
    np.testing.assert_allclose(
        turn_deg(np.array([350.0, 10, 90, 359]), np.array([10.0, 350, 60, 1])), [-20, 20, 30, -2]
    )


@pytest.mark.parametrize("kind", KINDS)
def test_each_colour_patch_has_a_hue_and_the_chart_has_none(kind: str) -> None:
    shown = painted(chart_kind(kind), TILTED)
    measured, expected = (scores(Hue(), shown, variant, kind) for variant in ("hsv", "hsv-expected"))
    assert list(measured) == list(expected) == [f"c/{p.number}-{p.name}" for p in chart_kind(kind).patches if p.colour]
    np.testing.assert_allclose([s.value for s in measured.values()], [s.value for s in expected.values()], atol=1e-4)


def test_expected_hues_are_those_of_the_published_lists() -> None:
    shown = np.zeros((300, 420, 3), np.float32)
    by_rgb, by_lab = (scores(Hue(), shown, f"{form}-expected") for form in ("hsv", "lab"))
    red, green, blue = 0, 173, 239  # the sRGB list's light blue: blue is largest, red smallest
    assert by_rgb["c/10-light-blue"].value == pytest.approx(60 * (4 + (red - green) / (blue - red)))
    assert by_lab["c/10-light-blue"].value == pytest.approx(180 + np.degrees(np.arctan(42 / 41)))


def test_a_chart_in_its_expected_colours_has_no_hue_error() -> None:
    assert scores(HueError(), painted(chart_kind("dgk"), TILTED), "hsv")["c"].value == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize("order", [[2, 0, 1], [1, 2, 0]])
def test_channels_turned_round_are_a_hue_error_of_120_degrees_in_every_patch(order: list[int]) -> None:
    found = scores(HueError(), painted(chart_kind("dgk"), TILTED)[..., order], "hsv")
    assert len(found) == 13
    np.testing.assert_allclose([s.value for s in found.values()], 120, atol=1e-3)


def test_a_patch_that_lost_its_hue_counts_90_degrees_and_one_that_was_not_restored_nothing() -> None:
    shown = painted(chart_kind("dgk"), TILTED)[..., [2, 0, 1]].copy()
    red = np.isclose(shown, np.array(chart_kind("dgk").patches[6].srgb)[[2, 0, 1]]).all(axis=-1)
    shown[red] = 0.4
    found = scores(HueError(), shown, "hsv")
    assert found["c"].value == pytest.approx((11 * 120 + 90) / 12, abs=1e-3)
    assert found["c"].coverage == pytest.approx(1)
    assert found["c/7-red"].value == 90
    shown[red] = np.nan
    found = scores(HueError(), shown, "hsv")
    assert found["c"].value == pytest.approx(120, abs=1e-3)
    assert found["c"].coverage == pytest.approx(11 / 12)
