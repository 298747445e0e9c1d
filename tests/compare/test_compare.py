import itertools
import json
import re
from dataclasses import astuple, replace

import numpy as np
import pandas as pd
import pytest
from support.made_rows import ROW, restored, rows_of, table

from sucre_bench import InputError, compare
from sucre_bench.compare.documents import as_text
from sucre_bench.compare.words import left_out
from sucre_bench.results.rows import Row, frame, replicated

pytestmark = pytest.mark.short


def cells(comparison: compare.Comparison) -> dict[str, compare.Cell]:
    chosen = comparison.columns[0]
    return {name: cell for (name, c), cell in comparison.cells.items() if c == chosen}


def test_a_method_that_failed_everywhere_is_a_hole_and_restricts_nobody():
    comparison = table({"a": [1, 2], "b": [None, None]})
    assert comparison.methods == ("a", "b")
    assert set(cells(comparison)) == {"a"}
    assert comparison.columns[0].n_scored == 2


def test_charts_of_one_view_are_not_independent():
    """Four charts a view, all of a view equal: the interval must be as wide as that of the views alone."""
    views = np.random.default_rng(3).normal(20, 3, 12)
    rows = pd.concat(
        rows_of({"m": list(views)}, metric="psi", region=f"chart{c}") for c in range(4)
    )
    (by_chart,) = compare.compare(rows)
    cell, alone = cells(by_chart)["m"], cells(table({"m": list(views)}))["m"]
    assert (by_chart.columns[0].n_scored, by_chart.columns[0].n_units) == (48, 12)
    assert cell.std == pytest.approx(np.std(views, ddof=1)), "over views, as the interval is"
    assert cell.high - cell.low == pytest.approx(alone.high - alone.low, rel=0.1)


def test_a_metric_without_its_plugin_is_named_and_nothing_is_said_of_what_it_knows():
    comparison = table({"a": [1, 2], "b": [2, 3]}, metric="of_a_plugin")
    (said,) = left_out(comparison)
    assert "of_a_plugin" in said
    assert "--plugin" in said
    records = json.loads(as_text([comparison], "json"))
    assert {record["knows"] for record in records} == {None}


def test_methods_that_ran_on_older_data_are_left_out_and_named():
    rows = [
        replace(ROW, method="old", data_id="d1"),
        replace(ROW, method="new", data_id="d2", time="2026-01-02"),
    ]
    (comparison,) = compare.compare(frame(rows))
    assert comparison.methods == ("new",)
    (said,) = left_out(comparison)
    assert "old" in said.split()


def test_a_scene_that_a_method_restored_from_older_data_is_no_scene_it_did_not_run():
    done = [("a", "d", "new"), ("a", "d", "old"), ("b", "d1", "old"), ("b", "d2", "new")]
    rows = [
        replace(ROW, scene=s, data_id=d, method=m, time=f"2026-01-0{n}")
        for n, (s, d, m) in enumerate(done, 1)
    ]
    (comparison,) = compare.compare(
        frame([*rows, *(replace(row, metric="seconds", variant="wall") for row in rows)])
    )
    (lost,) = images_lost(comparison)
    assert (lost["method"], lost["reasons"]) == ("old", "1 of other data")


def test_by_view_ranks_methods_within_each_view():
    first, second = compare.compare(rows_of({"a": [9.0, 1], "b": [8.0, 2]}), by="view")
    assert (first.title, second.title) == ("sea · v000", "sea · v001")
    assert (cells(first)["a"].rank, cells(second)["a"].rank) == (1, 2)


@pytest.mark.parametrize(
    ("of_folder", "named"),
    [(lambda name: {"method": name, "data_id": name}, r"^sea / reef: "), (lambda name: {"options_id": name}, "options"),
     (lambda name: {"code": name}, r"^sea / m: .*code")],
)  # fmt: skip
def test_folders_of_other_data_options_or_code_are_not_compared(
    tmp_path, of_folder, named: str
):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        frame([replace(ROW, **of_folder(name))]).to_parquet(tmp_path / name / "scores.parquet")
    with pytest.raises(InputError, match=named):
        compare.load([tmp_path / "one", tmp_path / "two"])


def test_folders_with_other_values_of_one_score_are_named(bench, tmp_path):
    """Rounding on another machine is no other value."""
    for name, value, time in (
        ("one", 1.0, "2026-01-02"),
        ("same", 1.0 + 1e-9, "2026-01-01"),
        ("two", 2.0, "2026-01-01"),
    ):
        (tmp_path / name).mkdir()
        rows = [
            replace(ROW, time=time, value=1.0 if view == "a" else value, view=view)
            for view in "abc"
        ]
        frame(rows).to_parquet(tmp_path / name / "scores.parquet")
    done = bench("compare", "one", "two", "--format", "csv")
    assert re.match(r"one, two .* 3 .* 2 .*\(sea / m\)", done.stderr)
    assert ",1.0," in done.stdout, "the newest"
    assert bench("compare", "one", "same").errors == []


def test_ranks_tie_where_chance_cannot_be_told_from_a_lead():
    """b is a little behind a in every view, c far behind both, d as good as c but for noise."""
    noise = np.random.default_rng(4).normal(0, 0.1, 12)
    far = list(np.linspace(10, 20, 12))
    made = cells(
        table(
            {
                "d": list(far + noise - 5),
                "a": far,
                "b": [x - 0.5 for x in far],
                "c": [x - 5 for x in far],
            }
        )
    )
    assert {name: cell.rank for name, cell in made.items()} == {"a": 1, "b": 2, "c": 3, "d": 3}
    assert {made["c"].place, made["d"].place} == {3, 4}
    assert not any(cell.tie for cell in made.values())


def test_wins_and_effect_are_those_counted_by_hand():
    made = cells(table({"a": [3, 5, 4, 1], "b": [2, 3, 1, 1], "c": [0, 5, 0, 0]}))
    assert {name: cell.wins for name, cell in made.items()} == {
        "a": 1 + 0.5 + 1 + 0.5,
        "b": 0.5,
        "c": 0.5,
    }
    differences = np.array([-1, -2, -3, 0])
    assert made["b"].effect == pytest.approx(differences.mean() / differences.std(ddof=1))
    assert np.isnan(made["a"].effect)


def test_infinite_scores_are_ranked_and_have_no_interval():
    """A perfect restoration has an infinite PSNR."""
    made = cells(
        table({"perfect": [np.inf, 30.0], "same": [np.inf, 29.0], "good": [29.0, 28.0]})
    )
    assert made["perfect"].mean == np.inf
    assert np.isnan(made["perfect"].low)
    assert np.isfinite(made["good"].low)
    assert (made["perfect"].rank, made["good"].rank, made["good"].tie) == (1, 3, False)
    assert (made["perfect"].wins, made["same"].wins) == (1.5, 0.5)


@pytest.mark.parametrize("better", ["higher", "lower"])
def test_against_a_baseline_differences_are_paired_and_signed_as_the_score_is(better: str):
    scores = {"base": [1.0, 5, 9, 4], "m": [2.0, 7, 10, 4]}
    (comparison,) = compare.compare(rows_of(scores, better=better), baseline="base")
    cell = cells(comparison)["m"]
    change, low, high = cell.change
    assert change == 1
    assert low < change < high
    assert cell.wins == (3.5 if better == "higher" else 0.5)
    expected = 1 / np.std([1, 2, 1, 0], ddof=1)
    assert cell.effect == pytest.approx(expected if better == "higher" else -expected)
    assert np.isnan(cells(comparison)["base"].change).all()


def test_a_baseline_that_did_not_run_on_a_dataset_is_said():
    rows = frame([ROW, replace(ROW, method="base"), replace(ROW, dataset="lake")])
    sea, lake = compare.compare(rows, baseline="base")
    assert (sea.baseline, lake.baseline) == ("base", "")
    assert left_out(lake)[0].startswith("base ")


@pytest.mark.parametrize(
    ("metric", "values", "low", "high"),
    [
        # of two views, 12.7062 / 1.96 * sqrt(2) times half their difference
        (
            "uiqm",
            [0.1, 2.0],
            -7.6598,
            9.7598,
        ),
        ("peak_mb", [0.1, 2.0], 0, 9.7598),
        ("ssim", [0.9, 1.0], 0.4916, 1),
        ("nobodys", [0.1, 2.0], -7.6598, 9.7598),
    ],
)
def test_no_interval_goes_beyond_what_a_metrics_values_can_be(
    metric: str, values: list[float | None], low: float, high: float
):
    cell = cells(table({"a": values}, metric=metric))["a"]
    assert (cell.low, cell.high) == pytest.approx((low, high), abs=1e-3)


def test_repetitions_of_a_view_are_one_view():
    """Three repeats of two views: as many views as without, each the mean of its repeats."""
    rows = [
        replace(
            ROW,
            view=f"v{v}",
            scene=f"reef,replicate={n}" if n else "reef",
            value=float(10 * v + n),
        )
        for v, n in itertools.product(range(2), range(3))
    ]
    (comparison,) = compare.compare(frame(rows))
    assert (comparison.columns[0].n_views, comparison.columns[0].n_scenes) == (2, 1)
    assert cells(comparison)["m"].mean == np.mean([1, 11])
    means = cells(table({"m": [1, 11]}))["m"]
    assert cells(comparison)["m"].low == means.low


def repeated(method: str, values: dict[int, float]) -> list[Row]:
    """A method's restorations and scores in some replicates, by the replicate's number."""
    return [
        replace(row, value=row.value if row.metric == "seconds" else value)
        for (n, value), view in itertools.product(values.items(), "ab")
        for row in restored(method, view, scene=replicated("reef", n))
    ]


def test_methods_are_compared_on_the_replicates_that_all_of_them_have():
    """b never ran the replicate where a is worst: taking each method's own mean would favour b."""
    rows = [*repeated("a", {0: 10, 1: 12, 2: 0}), *repeated("b", {0: 9, 1: 11})]
    (comparison,) = compare.compare(frame(rows), ["psnr"])
    assert {n: c.mean for n, c in cells(comparison).items()} == {"a": 11, "b": 10}
    (said,) = left_out(comparison)
    assert re.findall(r"^b|\d+", said) == [
        "b",
        "2",
        "6",
        "2",
        "2",
    ]  # of 6 replicates, of 2 images


def test_a_replicate_that_failed_as_a_whole_is_lost():
    whole = replace(restored("b", "", "boom", "failed")[0], scene="")
    rows = [*repeated("a", {0: 10, 1: 0}), *repeated("b", {0: 9}), whole]
    (comparison,) = compare.compare(frame(rows), ["psnr"])
    assert {n: c.mean for n, c in cells(comparison).items()} == {"a": 10, "b": 9}
    assert re.findall(r"^b|\d+", left_out(comparison)[0]) == ["b", "2", "4", "2", "2"]


LOST = r"(?P<method>\w+) .* (?P<n>\d+) of (?P<total>\d+) (?P<unit>\w+)s \((?P<reasons>.*)\)\D*(?P<left>\d*)"


def images_lost(comparison: compare.Comparison) -> list[dict[str, str]]:
    """The parts of each note on lost images, as `LOST` names them, and the metrics of the note."""
    found = [(note, re.match(LOST, note.text)) for note in comparison.notes]
    return [
        {**match.groupdict(), "metrics": " ".join(column.metric for column in note.columns)}
        for note, match in found
        if match
    ]


def test_holes_are_counted_and_said_with_their_reasons():
    views = [f"v{n}" for n in range(8)]
    rows = [row for view in views for row in restored("a", view)]
    rows += [row for view in views[3:] for row in restored("b", view)]
    rows += restored("b", "v0", "v0 has no depth map", "skipped")
    rows += [
        row
        for view in ("v1", "v2")
        for row in restored("b", view, "ValueError: boom", "failed")
    ]
    (comparison,) = compare.compare(frame(rows), ["psnr"])
    (lost,) = images_lost(comparison)
    assert lost.pop("reasons") == "2 failed: ValueError: boom; 1 skipped: has no depth map"
    assert [*lost.values()] == ["b", "3", "8", "image", "5", "psnr"]
    assert (cells(comparison)["a"].holes, cells(comparison)["b"].holes) == (0, 3)
    assert comparison.columns[0].n_scored == 5


def test_a_score_that_failed_alone_is_said_for_its_metric():
    rows = [
        row for view in ("v0", "v1") for row in (*restored("a", view), *restored("b", view))
    ]
    rows[-1] = replace(rows[-1], status="failed", reason="ValueError: boom", value=np.nan)
    (comparison,) = compare.compare(frame(rows))
    (lost,) = images_lost(comparison)
    assert lost.pop("reasons") == "1 failed: ValueError: boom"
    assert [*lost.values()] == ["b", "1", "2", "image", "1", "psnr"]


def test_some_charts_of_a_view_that_lack_a_score_are_counted_as_charts():
    rows = [
        replace(ROW, method=m, region=f"c{c}", metric="psi") for m in "ab" for c in range(3)
    ]
    rows[-1] = replace(rows[-1], status="skipped", reason="no value (NaN)", value=np.nan)
    (comparison,) = compare.compare(frame(rows))
    (lost,) = images_lost(comparison)
    assert lost.pop("reasons") == "1 skipped: no value (NaN)"
    assert [*lost.values()] == ["b", "1", "3", "chart", "2", "psi"]


def test_methods_without_a_common_view_are_not_compared():
    comparison = table({"a": [1, None], "b": [None, 2]})
    assert comparison.cells == {}
    (column,) = comparison.columns
    assert any("a, b" in note.text for note in comparison.notes if note.columns == (column,))


def test_by_region_a_view_that_failed_is_a_hole_of_every_region():
    charts = [
        replace(ROW, method=m, view=v, metric="psi", region=c)
        for m in "ab"
        for v in ("v0", "v1")
        for c in ("c0", "c1")
    ]
    whole = [row for m in "ab" for v in ("v0", "v1") for row in restored(m, v)[:1]]
    failed = restored("b", "v1", "boom", "failed")
    kept = [row for row in (*charts, *whole) if (row.method, row.view) != ("b", "v1")]
    tables = compare.compare(frame([*kept, *failed]), ["psi"], by="region")
    assert [t.title for t in tables] == ["sea · c0", "sea · c1"]
    for comparison in tables:
        lost = images_lost(comparison)[0]
        assert (lost["method"], lost["n"], lost["total"]) == ("b", "1", "2")
        assert (lost["metrics"], lost["reasons"]) == ("psi", "1 failed: boom")
        assert cells(comparison)["b"].holes == 1


def test_the_order_of_rows_changes_nothing():
    rng = np.random.default_rng(5)
    rows = [
        replace(
            ROW,
            method=m,
            scene=s,
            view=f"{s}{v}",
            region=f"c{c}",
            metric="psi",
            value=rng.normal(),
        )
        for m, s, v, c in itertools.product("abc", ("x", "y"), range(4), range(3))
    ]
    (one,) = compare.compare(frame(rows), order="abc")
    (other,) = compare.compare(
        frame([rows[n] for n in rng.permutation(len(rows))]), order="abc"
    )
    # NaN equals NaN, whichever object it is
    np.testing.assert_equal(astuple(other), astuple(one))


def test_a_score_that_nobody_has_is_in_no_note_about_pixels():
    """Without a reference there is no psnr: on which pixels it would have been interests nobody."""
    kinds = (
        {"metric": "seconds", "variant": "wall", "better": "lower"},
        {"metric": "uciqe", "variant": "yang2015"},
        {"status": "skipped", "value": np.nan, "reason": "needs reference"},
    )
    rows = pd.concat(rows_of({"whole": [1.0, 1], "half": [1.0, 1]}, **kind) for kind in kinds)
    rows["coverage"] = np.where(rows["method"] == "whole", 1.0, 0.5)
    on_common = np.where(rows["metric"] == "uciqe", "common", "own")
    (comparison,) = compare.compare(
        rows.assign(pixels=on_common, pixels_share=0.5, pixels_reason="")
    )
    named = [
        (note.kind, {c.metric for c in note.columns})
        for note in comparison.notes
        if note.columns
    ]
    assert named == [("common pixels", {"uciqe"})]


def test_differences_between_views_of_a_scene_are_shown_and_only_the_relative_ones_have_a_direction():
    """Pictures without contrast differ least between views, so nobody wins by the absolute differences."""
    rows = pd.concat(
        rows_of(
            {"flat": [1.0, 1], "colourful": [3.0, 3]},
            metric="consistency",
            variant=variant,
            better="lower",
        )
        for variant in ("patches", "relative")
    )
    (comparison,) = compare.compare(rows)
    assert {column.variant: column.better for column in comparison.columns} == {
        "patches": "none",
        "relative": "lower",
    }
    assert len(comparison.cells) == 4
