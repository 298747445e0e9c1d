"""Consistency, contrast, range slope and matches, on scenes of which the colours and the water are known."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from skimage.color import deltaE_ciede2000, rgb2lab
from support.made_ground import WATERS, make_ground, water
from support.made_scene import WATER, make_camera, make_pose, make_view

from sucre_bench import Scene, results
from sucre_bench.compare import compare
from sucre_bench.engine.across_views import Entrant, pair_rows
from sucre_bench.engine.score import scorers
from sucre_bench.imaging.display import display
from sucre_bench.jobs.catalogue import metric_choices
from sucre_bench.restored_pair import RestoredView
from sucre_bench.results.rows import Row


def pair_scores(
    scene: Scene, images: Mapping[str, Mapping[str, np.ndarray]], *metrics: str
) -> pd.DataFrame:
    """The rows of some methods. images: what each method made of each view; metrics: as `sucre_bench.score` takes."""
    chosen = scorers(metric_choices(metrics))

    def entrant(method: str) -> Entrant:
        def opened(name: str) -> RestoredView:
            image = images[method][name].astype(np.float32)
            return RestoredView(
                scene[name], lambda: display(image, "none", scene[name].encoding), lambda: image
            )

        bases = {
            name: Row(dataset="made", scene=scene.name, view=name, method=method)
            for name in images[method]
        }
        return Entrant(bases, opened, chosen)

    made = pair_rows(scene, [entrant(method) for method in images])
    return results.frame([row for rows in made for row in rows])


def references(scene: Scene) -> dict[str, np.ndarray]:
    return {view.name: np.asarray(view.reference) for view in scene}


def inputs(scene: Scene) -> dict[str, np.ndarray]:
    return {view.name: view.rgb for view in scene}


def mean(rows: pd.DataFrame, method: str, metric: str, variant: str) -> float:
    chosen = rows[
        (rows["method"] == method) & (rows["metric"] == metric) & (rows["variant"] == variant)
    ]
    chosen = chosen[chosen["region"] == "image"]
    assert (chosen["status"] == "ok").all(), chosen["reason"].tolist()
    return float(chosen["value"].mean())


@pytest.fixture(scope="module")
def hazy() -> Scene:
    return make_ground(WATERS["coast"])


# -- range slope -------------------------------------------------------------------------------------------


def in_linear_light(scene: Scene) -> Scene:
    return replace(scene, views=[replace(view, encoding="linear") for view in scene])


def test_in_water_without_veil_the_inputs_slope_is_minus_the_attenuation():
    beta = (0.3, 0.12, 0.05)
    scene = in_linear_light(make_ground(water((0, 0, 0), beta, (0.1, 0.1, 0.1)), noise=0))
    rows = pair_scores(
        scene, {"input": inputs(scene), "truth": references(scene)}, "range_slope:all"
    )
    for channel, attenuation in zip(("red", "green", "blue"), beta, strict=True):
        assert mean(rows, "input", "range_slope", channel) == pytest.approx(
            -attenuation, abs=0.003
        )
    assert mean(rows, "input", "range_slope", "mean") == pytest.approx(
        -np.mean(beta), abs=0.003
    )


@pytest.mark.parametrize("is_linear", [False, True])
def test_the_truths_slope_is_zero_within_its_interval_and_the_inputs_is_not(
    hazy: Scene, is_linear: bool
):
    scene = in_linear_light(hazy) if is_linear else hazy
    rows = pair_scores(
        scene,
        {"truth": references(scene), "input": inputs(scene)},
        "range_slope",
        "range_slope_error",
    )
    (table,) = compare(rows)
    cells = {
        (method, column.metric, column.variant): cell
        for (method, column), cell in table.cells.items()
    }
    for channel in ("red", "green", "blue"):
        cell = cells["truth", "range_slope", channel]
        assert cell.low <= 0 <= cell.high
        assert cell.high - cell.low < 0.02
    red = cells["input", "range_slope", "red"]
    assert red.high < -0.1
    (against,) = compare(rows, ["range_slope_error:raw"], baseline="truth")
    (error,) = (cell for (method, column), cell in against.cells.items() if method == "input")
    assert error.change[1] > 0


# -- consistency -------------------------------------------------------------------------------------------


def test_consistency_is_the_difference_between_two_flat_colours(hazy: Scene):
    # grays: their Lab is the same under every white
    colours = (
        np.full(3, 0.4),
        np.full(3, 0.45),
    )
    scene = replace(hazy, views=hazy.views[:2])
    images = {
        view.name: np.ones_like(view.rgb) * colour
        for view, colour in zip(scene, colours, strict=True)
    }
    rows = pair_scores(scene, {"flat": images}, "consistency:all", "point_contrast")
    expected = deltaE_ciede2000(*(rgb2lab(colour) for colour in colours))
    assert mean(rows, "flat", "consistency", "patches") == pytest.approx(expected, rel=1e-3)
    assert mean(rows, "flat", "point_contrast", "patches") == pytest.approx(0, abs=1e-3)
    relative = rows[(rows["metric"] == "consistency") & (rows["variant"] == "relative")]
    assert set(relative["status"]) == {"skipped"} or relative["value"].min() > 100


def test_the_truth_is_consistent_and_the_input_is_not():
    places = [
        ((0.1, 0.05, 0.6), 0.06),
        ((0, 0, 0), 0.0),
        ((0.3, -0.2, -0.6), -0.12),
        ((-0.3, 0.1, -2.4), 0.04),
    ]
    cameras = [make_camera(160, 120, focal) for focal in (130, 140, 150, 180)]
    wet, dry = (
        [
            make_view(f"{n}.png", cameras[n], make_pose(*place), water)
            for n, place in enumerate(places)
        ]
        for water in (WATER, None)
    )
    scene = Scene("made", wet, frozenset({"depth", "poses"}))
    images = {"truth": {view.name: view.rgb for view in dry}, "input": inputs(scene)}
    rows = pair_scores(scene, images, "consistency:all", "point_contrast")
    assert mean(rows, "truth", "consistency", "patches") < 0.3
    assert mean(rows, "input", "consistency", "patches") > 3
    assert (
        mean(rows, "truth", "consistency", "relative")
        < mean(rows, "input", "consistency", "relative") / 20
    )
    assert mean(rows, "truth", "point_contrast", "patches") > mean(
        rows, "input", "point_contrast", "patches"
    )


def test_differences_of_colour_grow_with_differences_of_distance(hazy: Scene):
    rows = pair_scores(hazy, {"input": inputs(hazy)}, "consistency:patches")
    by_range = rows[rows["region"] != "image"].groupby("region")["value"].mean()
    assert by_range["image/0.25-0.5 m"] < by_range["image/1-2 m"] < by_range["image/2-4 m"]


def test_only_points_with_a_colour_in_both_views_count(hazy: Scene):
    half = inputs(hazy)
    half["0.png"] = half["0.png"].copy()
    half["0.png"][:, :60] = np.nan
    rows = pair_scores(hazy, {"whole": inputs(hazy), "half": half}, "consistency:patches")
    coverage = rows[(rows["region"] == "image") & (rows["view"] == "0.png")].set_index(
        "method"
    )["coverage"]
    assert coverage["whole"] == 1
    assert 0.3 < coverage["half"] < 0.7


# -- matches -----------------------------------------------------------------------------------------------


def test_matches_of_the_photographs_themselves_are_as_many_and_of_the_truth_more():
    dense = water((0.40, 0.50, 0.48), (0.9, 0.7, 0.7), (0.9, 0.8, 0.8))
    scene = make_ground(dense, width=240, height=180, heights_m=(1.2, 1.4, 1.6))
    gray = {view.name: np.full_like(view.rgb, 0.5) for view in scene}
    images = {"input": inputs(scene), "truth": references(scene), "gray": gray}
    rows = pair_scores(scene, images, "matches:all")
    assert mean(rows, "input", "matches", "ratio") == 1
    assert mean(rows, "input", "matches", "doublings") == 0
    assert mean(rows, "truth", "matches", "ratio") > 1.5
    assert mean(rows, "truth", "matches", "doublings") > 0.5
    assert mean(rows, "gray", "matches", "ratio") == 0


def test_photographs_without_a_match_have_no_ratio_and_the_reason_says_so():
    scene = make_ground(water((0.40, 0.50, 0.48), (60.0,) * 3, (60.0,) * 3))  # veil only
    rows = pair_scores(scene, {"truth": references(scene)}, "matches:all")
    of = rows.groupby("variant")
    assert set(of.get_group("ratio")["status"]) == {"skipped"}
    assert all("matches" in reason for reason in of.get_group("ratio")["reason"])
    assert set(of.get_group("doublings")["status"]) == {"ok"}
