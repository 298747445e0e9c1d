"""The figures residuals, scaling and seams, against the rows and files that they are drawn from."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest
from support.made_observations import made, parameters
from support.made_results import drawn, keep
from support.made_scene import WATER

from sucre_bench.methods.sucre.record import residuals
from sucre_bench.methods.sucre.solution import colours_for_water
from sucre_bench.results.layout import Place
from sucre_bench.results.rows import Row, frame

Fitted = tuple[pd.DataFrame, dict[str, Any]]
WATER_ROWS = np.stack([WATER.veiling_light, WATER.attenuation, WATER.backscatter])


ROW = Row("made", "s", "a.png", "m", value=1.0)


def eight_bits(rgb: np.ndarray) -> np.ndarray:
    return np.rint(rgb[..., ::-1] * 255).astype(np.uint8)


@pytest.fixture
def fitted(tmp_path: Path) -> Fitted:
    """One restoration of normal noise with what it leaves, and its row."""
    observations, _ = made(3_000, noise=0.01)
    J = colours_for_water(observations, parameters(WATER), None, "numpy", "cpu").J
    left = residuals(observations, J, parameters(WATER))
    info = {"n_observations": len(observations), "residuals": left} | dict(
        zip(("B", "beta", "gamma"), WATER_ROWS.tolist(), strict=True)
    )
    keep(tmp_path, ROW, info)
    return frame([ROW]), info


def test_the_histogram_holds_all_and_its_normal_curve_has_area_1(
    fitted: Fitted, tmp_path: Path
) -> None:
    ((suffix, figure),) = drawn("residuals", fitted[0], tmp_path).items()
    assert suffix == "made-m-a"
    assert [axis.get_title() for axis in figure.axes[:3]] == ["red", "green", "blue"]
    axis = figure.axes[1]
    values, edges, _ = axis.patches[0].get_data()
    assert (values * np.diff(edges)).sum() == pytest.approx(1)
    x, y = axis.lines[0].get_data()
    assert np.trapezoid(y, x) == pytest.approx(1, abs=1e-3)
    assert x[np.argmax(y)] == pytest.approx(0, abs=1e-3)
    assert y.max() == pytest.approx(1 / (0.01 * np.sqrt(2 * np.pi)), rel=0.05)


def test_the_density_has_residuals_upwards_and_fits_to_the_right(
    fitted: Fitted, tmp_path: Path
) -> None:
    rows, info = fitted
    axis = drawn("residuals", rows, tmp_path)["made-m-a"].axes[8]
    known = info["residuals"]["against_fit"]["blue"]
    (mesh,) = axis.collections
    np.testing.assert_array_equal(mesh.get_array().filled(0), np.transpose(known["counts"]))
    corners = mesh.get_coordinates()
    assert corners[0, [0, -1], 0].tolist() == pytest.approx(known["fit"])
    assert corners[[0, -1], 0, 1].tolist() == pytest.approx(known["residual"])


def test_curves_over_distance_are_the_models(fitted: Fitted, tmp_path: Path) -> None:
    axis = drawn("residuals", fitted[0], tmp_path)["made-m-a"].axes[9]
    dotted = [line for line in axis.lines if line.get_linestyle() == ":"]
    B, beta, gamma = WATER_ROWS[:, 0]
    assert len(dotted) == 6
    for line in dotted:
        z, I = line.get_data()
        J = (I[0] - B * (1 - np.exp(-gamma * z[0]))) / np.exp(-beta * z[0])
        np.testing.assert_allclose(
            I, J * np.exp(-beta * z) + B * (1 - np.exp(-gamma * z)), rtol=1e-9
        )


def timed(out: Path, n: float, seconds: float) -> list[Row]:
    own = replace(ROW, view=f"{n:.0f}.png", value=seconds)
    keep(out, own, {"stage_seconds": {"pair": 0.25 * seconds, "solve": 0.75 * seconds}})
    return [own, replace(own, metric="observations", variant="all", value=n)]


def test_scaling_draws_each_restoration_once_and_names_its_slope(tmp_path: Path) -> None:
    n = np.geomspace(1e5, 4e6, 6)
    rows = [r for k in n for r in timed(tmp_path, k, 0.1 + 2e-6 * k * (1 + 0.01 * np.sin(k)))]
    ((suffix, figure),) = drawn("scaling", frame(rows), tmp_path).items()
    assert suffix == ""
    assert [axis.get_title() for axis in figure.axes] == [
        "whole restoration",
        "pairing",
        "solving",
    ]
    points = next(line for line in figure.axes[0].lines if line.get_linestyle() == "None")
    np.testing.assert_allclose(np.sort(points.get_xdata()), np.sort(n))
    np.testing.assert_allclose(
        figure.axes[2].lines[-1].get_ydata(), 0.75 * np.array(points.get_ydata())
    )
    (label,) = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert label.startswith("m: 2 ± ")
    assert label.endswith(" million")


@pytest.fixture
def stitched(tmp_path: Path) -> pd.DataFrame:
    """A view, a method that leaves it alone, and one with an upright seam at two thirds of the width."""
    rng = np.random.default_rng(0)
    photograph = np.clip(
        0.4 + 0.1 * cv2.GaussianBlur(rng.standard_normal((120, 180, 3)), (0, 0), 3) * 10,
        0.05,
        0.8,
    )
    seam = photograph + (np.arange(180) >= 120)[None, :, None] * 0.15
    rows = []
    for method, picture, value in (("same", photograph, 0.0), ("seam", seam, 0.03)):
        own = replace(ROW, method=method, metric="seams", variant="visible", value=value)
        keep(tmp_path, own, {}, eight_bits(picture))
        rows.append(own)
    original = Place("made", Path("a")).original(tmp_path)
    cv2.imwrite(str(original), eight_bits(photograph))
    return frame(rows)


def test_steps_are_drawn_below_the_picture_that_has_them_the_worst_first(
    stitched: pd.DataFrame, tmp_path: Path
) -> None:
    ((suffix, figure),) = drawn("seams", stitched, tmp_path).items()
    assert suffix == "made-a"
    axes = np.array(figure.axes[:6]).reshape(2, 3)
    titles = [axis.get_title() for axis in axes[0]]
    assert titles == ["photograph\n", "seam\nseams 3.00%", "same\nseams 0.00%"]
    steps = axes[1, 1].images[0].get_array()
    assert np.nanmax(steps[20:-20, 118:122]) > 0.1
    assert np.nanmax(steps[20:-20, 20:90]) < 0.05
