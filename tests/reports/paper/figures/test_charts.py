"""The figures charts, swatches, hue and water: what is drawn is what the rows say."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from support.made_results import chart_rows, drawn, keep

from sucre_bench import results
from sucre_bench.errors import NotApplicableError
from sucre_bench.results.rows import Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes

METHODS = ("underwater", "sucre")
VIEWS = ("a.png", "b.png", "c.png")
CHARTS = ("near", "far")
PATCHES = ("7-red", "8-yellow", "9-green")
DISTANCE = {
    (view, chart): 1.5 + v + 4.1 * c
    for v, view in enumerate(VIEWS)
    for c, chart in enumerate(CHARTS)
}
EXPECTED = {"7-red": (0.9, 0.1, 0.1), "8-yellow": (1.0, 0.9, 0.0), "9-green": (0.4, 0.7, 0.3)}
EXPECTED_HUE = {"7-red": 0.0, "8-yellow": 54.0, "9-green": 105.0}
MEASURED = (0.25, 0.5, 0.75)


def error(method: str, view: str, chart: str, patch: str) -> float:
    """A number that tells method, view, chart and patch."""
    return (
        100 * METHODS.index(method)
        + 10 * VIEWS.index(view)
        + 5 * CHARTS.index(chart)
        + 0.5 * PATCHES.index(patch)
        + 1
    )


def rows_of_charts(hue: float = 0.0) -> Iterator[Row]:
    """Scores of two charts in three views; sucre's hues are off by `hue`, underwater's by none."""
    for method, view in product(METHODS, VIEWS):
        own = Row("dive", "s", view, method, value=1)
        yield own
        off = hue * (method == "sucre")
        for chart in CHARTS:
            errors = {patch: error(method, view, chart, patch) for patch in PATCHES}
            yield from chart_rows(
                own,
                chart,
                DISTANCE[view, chart],
                {"psi": errors, "de00": errors},
                {patch: ((known + off) % 360, known) for patch, known in EXPECTED_HUE.items()},
                {patch: (MEASURED, known) for patch, known in EXPECTED.items()},
            )


def lines(axes: Axes, label: str) -> np.ndarray:
    """x and y (2, N) of the line of that label."""
    (line,) = [line for line in axes.lines if line.get_label() == label]
    return np.array(line.get_data(), dtype=float)


def test_charts_draws_each_charts_error_at_its_distance_with_the_spread_of_its_patches() -> (
    None
):
    (figure,) = drawn("charts", results.frame(rows_of_charts())).values()
    psi = figure.axes[0]
    by_distance = sorted(DISTANCE, key=lambda site: DISTANCE[site])
    for method in METHODS:
        x, y = lines(psi, method)
        np.testing.assert_allclose(x, [DISTANCE[site] for site in by_distance], atol=0.05)
        np.testing.assert_allclose(
            y, [error(method, *site, PATCHES[1]) for site in by_distance]
        )
    bars = psi.collections[0].get_segments()
    spread = np.std([0, 0.5, 1], ddof=1)
    np.testing.assert_allclose([np.ptp(bar[:, 1]) for bar in bars], 2 * spread)
    assert len(figure.axes) == 2
    assert [text.get_text() for text in figure.legends[0].get_texts()] == list(METHODS)


def test_charts_has_a_panel_for_each_error_or_for_those_the_study_names() -> None:
    rows = list(rows_of_charts())
    rows += [
        replace(row, variant="w", value=2 * row.value) for row in rows if row.metric == "de00"
    ]
    (everything,) = drawn("charts", results.frame(rows)).values()
    (named,) = drawn("charts", results.frame(rows), metrics=("de00:w",)).values()
    assert [axes.get_visible() for axes in everything.axes] == [True, True, True, False]
    (only,) = named.axes
    assert lines(only, "sucre")[1][0] == 2 * error("sucre", "a.png", "near", PATCHES[1])


def test_swatches_show_measured_and_expected_colours_of_the_nearest_and_farthest_chart_with_their_difference() -> (
    None
):
    (figure,) = drawn("swatches", results.frame(rows_of_charts())).values()
    near, far = figure.axes
    assert near.get_title() == "near, 1.5 m"
    assert far.get_title() == "far, 7.6 m"
    assert [label.get_text() for label in near.get_yticklabels()] == list(METHODS)
    assert [label.get_text() for label in near.get_xticklabels()] == ["red", "yellow", "green"]
    painted = [patch.get_facecolor()[:3] for patch in near.patches]
    assert painted[::2] == [MEASURED] * 6
    np.testing.assert_allclose(painted[1::2], [EXPECTED[patch] for patch in PATCHES] * 2)
    said = [float(text.get_text()) for text in far.texts]
    truth = [error(method, "c.png", "far", patch) for method in METHODS for patch in PATCHES]
    np.testing.assert_allclose(said, truth, atol=0.5)


@pytest.mark.parametrize("off", [0, 40, -40, 170, -170])
def test_hue_is_drawn_within_half_a_turn_of_the_expected_one(off: float) -> None:
    (figure,) = drawn("hue", results.frame(rows_of_charts(off))).values()
    assert [axes.get_title() for axes in figure.axes[:3]] == ["red", "yellow", "green"]
    for axes, patch in zip(figure.axes, PATCHES, strict=False):
        expected = EXPECTED_HUE[patch]
        assert lines(axes, "_child0")[1].tolist() == [expected, expected]
        np.testing.assert_allclose(lines(axes, "sucre")[1], expected + off)
        np.testing.assert_allclose(lines(axes, "underwater")[1], expected)
        assert axes.get_ylim() == (expected - 180, expected + 180)


# -- water -------------------------------------------------------------------------------------------------

PARAMETERS = ("veiling_light", "attenuation", "backscatter")
TRUE = {
    "B": [0.1, 0.3, 0.4],
    "beta": [0.5, 0.2, 0.1],
    "gamma": [0.3, 0.2, 0.2],
    "encoding": "gamma",
}


def water_rows() -> Iterator[Row]:
    """Parameters 1, 2, 3 ... of a channel in views whose distances vary by 1, 4, 9 ..."""
    for method, (k, view) in product(METHODS, enumerate(VIEWS)):
        own = Row("dive", "s", view, method)
        yield replace(own, metric="distance_variance", variant="image", value=(k + 1) ** 2)
        for p, c in product(range(3), range(3)):
            yield replace(
                own,
                metric="water_parameters",
                variant=f"{PARAMETERS[p]}-{('red', 'green', 'blue')[c]}",
                value=100 * p + 10 * c + k + 1,
            )


def keep_records(out: Path, encoding: str) -> None:
    """What a run leaves beside its pictures."""
    told = {"B": [0, 0, 0], "encoding": encoding, "true_water": TRUE}
    for method, view in product(METHODS, VIEWS):
        keep(out, Row("dive", "s", view, method), told)


def test_water_draws_each_views_parameters_over_the_variance_of_its_distances() -> None:
    (figure,) = drawn("water", results.frame(water_rows())).values()
    panels = np.array(figure.axes).reshape(3, 2)
    assert [panel.get_title() for panel in panels[0]] == list(METHODS)
    for p, m in product(range(3), range(2)):
        for c, dots in enumerate(panels[p, m].collections):
            np.testing.assert_allclose(
                dots.get_offsets(), [[(k + 1) ** 2, 100 * p + 10 * c + k + 1] for k in range(3)]
            )
    said = [float(text.get_text().removesuffix(" %")) for text in panels[0, 0].texts]
    np.testing.assert_allclose(said, [100 / 2, 100 / 12, 100 / 22], atol=0.01)
    assert not panels[0, 0].lines


def test_water_draws_the_truth_where_it_explains_the_same_intensities(tmp_path: Path) -> None:
    keep_records(tmp_path, "gamma")
    (figure,) = drawn("water", results.frame(water_rows()), tmp_path).values()
    panels = np.array(figure.axes).reshape(3, 2)
    for p, name in enumerate(("B", "beta", "gamma")):
        assert [line.get_ydata()[0] for line in panels[p, 1].lines] == TRUE[name]
    assert "true" in figure.get_supxlabel()
    keep_records(tmp_path, "linear")
    (figure,) = drawn("water", results.frame(water_rows()), tmp_path).values()
    assert not any(axes.lines for axes in figure.axes)


@pytest.mark.parametrize("name", ["charts", "swatches", "hue", "water"])
def test_without_anything_to_draw_it_is_said_which_metrics_to_add(name: str) -> None:
    rows = results.frame(
        [Row(dataset="d", scene="s", view="a.png", method="m", metric="psnr", value=20)]
    )
    with pytest.raises(NotApplicableError, match=r"; add .*(chart_distance|distance_variance)"):
        drawn(name, rows)
    if name != "water":
        distances = results.frame(
            row for row in rows_of_charts() if row.metric == "chart_distance"
        )
        with pytest.raises(NotApplicableError, match="add metrics="):
            drawn(name, distances)
