"""Scores of colour charts, psi, de00, hue and neutral: published colours, and charts painted in known ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from support.made_scene import TILTED, painted

from sucre_bench.arrays import Array
from sucre_bench.imaging.chart_kinds import KINDS, chart_kind
from sucre_bench.imaging.cielab import ciede2000
from sucre_bench.metrics.chart_colours import (
    De00,
    HueError,
    Neutral,
    PatchColour,
    Psi,
    angle_deg,
    hue_deg,
)
from sucre_bench.scene import Arrays, Chart, Restoration, Score, View

# Sharma, Wu & Dalal 2005, table 1: Lab, Lab, dE00 (pairs 1, 7, 16 and 34; scikit-image tests them all).
SHARMA = [
    ((50, 2.6772, -79.7751), (50, 0, -82.7485), 2.0425),
    ((50, 0, 0), (50, -1, 2), 2.3669),
    ((50, 2.5, 0), (50, 0, -2.5), 4.3065),
    ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082),
]


def scores(
    metric: Any,
    shown: Array,
    variant: str,
    kind: str = "dgk",
    charts: list[Chart] | None = None,
) -> dict[str, Score]:
    view = View("a.png", Arrays(shown), charts=charts or [Chart("c", kind, TILTED)])
    return {s.region: s for s in metric.score(Restoration(shown), shown, view, variant)}


@pytest.mark.parametrize(("a", "b", "published"), SHARMA)
def test_ciede2000_reproduces_the_published_pairs(a: Array, b: Array, published: float) -> None:
    assert ciede2000(np.array(a, float), np.array(b, float)) == pytest.approx(
        published, abs=5e-5
    )


def test_angles_by_hand() -> None:
    a = np.array([[1.0, 0, 0], [1, 1, 1], [1, 1, 0], [0.3, 0.6, 0.9], [0, 0, 0]])
    b = np.array([[0, 1.0, 0], [1, 0, 0], [0, 1, 1], [0.1, 0.2, 0.3], [1, 1, 1]])
    found = angle_deg(a, b)
    np.testing.assert_allclose(
        found[:4], [90, np.degrees(np.arccos(3**-0.5)), 60, 0], atol=2e-6
    )
    assert np.isnan(found[4]), "black has no direction"


@pytest.mark.parametrize("kind", KINDS)
def test_a_chart_in_its_expected_colours_has_no_error(kind: str) -> None:
    shown = painted(chart_kind(kind), TILTED)
    # float32
    assert scores(Psi(), shown, "colour", kind)["c"].value == pytest.approx(0, abs=0.05)
    assert scores(Psi(), shown, "all", kind)["c"].value == pytest.approx(0, abs=0.05)
    assert scores(De00(), shown, "srgb", kind)["c"].value == pytest.approx(0, abs=1e-4)


def test_every_chart_and_every_patch_has_a_score_and_the_chart_is_the_mean() -> None:
    rng = np.random.default_rng(2)
    shown = rng.random((300, 420, 3)).astype(np.float32)
    charts = [Chart("near", "dgk", TILTED), Chart("far", "colorchecker24", TILTED * 0.3 + 20)]
    for metric, variant in [
        (Psi(), "colour"),
        (Psi(), "all"),
        (De00(), "lab"),
        (De00(), "srgb"),
    ]:
        found = scores(metric, shown, variant, charts=charts)
        every = variant == "all"
        for chart, n in [("near", 18 if every else 12), ("far", 24 if every else 18)]:
            patches = [s for region, s in found.items() if region.startswith(chart + "/")]
            assert len(patches) == n
            assert found[chart].value == pytest.approx(np.mean([s.value for s in patches]))
            assert found[chart].n_pixels == sum(s.n_pixels for s in patches)
            assert found[chart].coverage == 1
    assert "near/7-red" in scores(Psi(), shown, "colour", charts=charts)


def blanked(colour: float) -> tuple[dict[str, Score], dict[str, Score]]:
    """Scores of a chart with every patch tinted, before and after the red one is lost to `colour`."""
    kind = chart_kind("dgk")
    shown = painted(kind, TILTED)
    red = np.isclose(shown, kind.patches[6].srgb).all(axis=-1)
    shown = shown * np.float32([0.5, 1, 1])
    whole = scores(Psi(), shown, "colour")
    shown[red] = colour
    return whole, scores(Psi(), shown, "colour")


@pytest.mark.parametrize("colour", [np.nan, 0.0], ids=["hole", "black"])
def test_a_patch_without_a_direction_is_left_out_of_the_mean_and_lowers_the_coverage(
    colour: float,
) -> None:
    whole, holed = blanked(colour)
    others = [s.value for region, s in whole.items() if region not in ("c", "c/7-red")]
    assert holed["c"].value == pytest.approx(np.mean(others))
    assert abs(holed["c"].value - whole["c"].value) > 0.1
    assert holed["c"].coverage == pytest.approx(11 / 12)
    assert np.isnan(holed["c/7-red"].value)
    assert (holed["c/7-red"].coverage, holed["c/7-red"].n_pixels) == (0, 0)


def test_the_reference_list_shifts_psi() -> None:
    shown = painted(chart_kind("dgk"), TILTED)
    by_lab = scores(Psi(), shown, "colour-lab")
    # the lists' largest disagreement
    assert by_lab["c/12-magenta"].value == pytest.approx(13.8, abs=0.1)
    assert by_lab["c/13-brick"].value < 0.5


def test_measured_reflectances_are_the_third_list_and_other_charts_lack_it() -> None:
    shown = painted(chart_kind("dgk"), TILTED)
    by_spectra = scores(Psi(), shown, "colour-measured")
    red = angle_deg(np.array([235.0, 28, 36]), np.array([155.0, 55, 47]))
    assert by_spectra["c/7-red"].value == pytest.approx(red, abs=0.1)
    others = scores(Psi(), shown, "colour-measured", "colorchecker24")
    assert all(np.isnan(s.value) and s.coverage == 0 for s in others.values())


def test_patch_colour_gives_each_channel_as_shown_and_as_the_list_has_it() -> None:
    shown = painted(chart_kind("dgk"), TILTED) * np.float32([0.5, 0.25, 1])
    for c, channel in enumerate(("red", "green", "blue")):
        measured, expected = (
            scores(PatchColour(), shown, f"{channel}{end}") for end in ("", "-expected")
        )
        assert len(measured) == 18
        assert "c/7-red" in measured
        listed = np.array([expected[region].value for region in measured])
        np.testing.assert_allclose(listed, [p.srgb[c] for p in chart_kind("dgk").patches])
        np.testing.assert_allclose(
            [s.value for s in measured.values()], listed * (0.5, 0.25, 1)[c], atol=1e-6
        )


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
def test_hsv_hue_is_the_angle_on_the_hexagon_whatever_saturation_and_value(
    rgb: Array, hue: float
) -> None:
    assert hue_deg(np.array(rgb, float), "hsv") == pytest.approx(hue, abs=1e-9)


@pytest.mark.parametrize(
    ("rgb", "a", "b"),  # the sRGB primaries in Lab under D50, as in ICC profiles (Lindbloom)
    [((1, 0, 0), 80.80, 69.89), ((0, 1, 0), -79.29, 80.99), ((0, 0, 1), 68.30, -112.03)],
)
def test_lab_hue_is_that_of_the_primaries_under_d50(rgb: Array, a: float, b: float) -> None:
    assert hue_deg(np.array(rgb, float), "lab") == pytest.approx(
        np.degrees(np.arctan2(b, a)) % 360, abs=0.03
    )


def test_a_patch_that_lost_its_hue_counts_90_degrees_and_one_that_was_not_restored_nothing() -> (
    None
):
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


def test_a_picture_of_one_colour_has_that_colours_chroma_in_every_gray_patch() -> None:
    shown = np.empty((300, 420, 3), np.float32)
    shown[:] = (1, 0, 0)  # Lab under D50: 54.29, 80.80, 69.89 (Lindbloom)
    found = scores(Neutral(), shown, "chroma")
    assert list(found) == [
        "c",
        *(f"c/{p.number}-{p.name}" for p in chart_kind("dgk").patches if not p.is_chromatic),
    ]
    np.testing.assert_allclose(
        [s.value for s in found.values()], np.hypot(80.80, 69.89), atol=0.06
    )


def test_grays_of_any_brightness_have_no_chroma_and_colours_do_not_count() -> None:
    shown = painted(chart_kind("dgk"), TILTED)
    is_gray = np.ptp(shown, axis=-1) < 0.03
    shown[is_gray] = shown[is_gray].mean(axis=-1, keepdims=True)
    assert scores(Neutral(), shown, "chroma")["c"].value == pytest.approx(0, abs=0.05)
    assert scores(Neutral(), shown[..., [2, 0, 1]], "chroma")["c"].value == pytest.approx(
        0, abs=0.05
    )
