from __future__ import annotations

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest

from sucre_bench import InputError, compare
from sucre_bench.results import Row, frame

ROW = Row(
    dataset="sea", scene="reef", view="a", method="m", options="{}", options_id="o", metric="psnr", variant="masked",
    region="image", value=1.0, unit="dB", better="higher", n_pixels=4, coverage=1.0, status="ok", reason="",
    seconds=1.0, peak_mb=2.0, device="cpu", seed=0, code="c", data_id="d", time="2026-01-01",
)  # fmt: skip


def table(scores: dict[str, list[float | None]], **kind: str) -> compare.Comparison:
    """A comparison of methods whose values by view are given; None is a failed view."""
    rows = [
        replace(
            ROW, method=method, view=f"v{view:03}", value=np.nan if value is None else value,
            status="failed" if value is None else "ok", time=f"2026-01-0{order + 1}", **kind,
        )
        for order, (method, values) in enumerate(scores.items())
        for view, value in enumerate(values)
    ]  # fmt: skip
    (comparison,) = compare.compare(frame(rows))
    return comparison


def cells(comparison: compare.Comparison, column: int = 0) -> dict[str, compare.Cell]:
    chosen = comparison.columns[column]
    return {name: cell for (name, c), cell in comparison.cells.items() if c == chosen}


def test_the_better_direction_decides_the_rank():
    higher = cells(table({"a": [1, 2], "b": [3, 4]}))
    lower = cells(table({"a": [1, 2], "b": [3, 4]}, better="lower"))
    assert (higher["a"].rank, higher["b"].rank) == (2, 1)
    assert (lower["a"].rank, lower["b"].rank) == (1, 2)


def test_methods_are_compared_only_on_what_all_of_them_have():
    """b failed on the view where a is worst: taking each method's own mean would favour b."""
    comparison = table({"a": [10, 10, 0], "b": [9, 9, None]})
    assert {n: c.mean for n, c in cells(comparison).items()} == {"a": 10, "b": 9}
    assert (comparison.columns[0].n_units, comparison.columns[0].missing) == (2, 1)


def test_a_method_that_failed_everywhere_is_a_hole_and_restricts_nobody():
    comparison = table({"a": [1, 2], "b": [None, None]})
    assert comparison.rows == ("a", "b")
    assert set(cells(comparison)) == {"a"}
    assert comparison.columns[0].n_units == 2


def test_the_interval_of_a_mean_is_that_of_the_normal_theory():
    values = np.random.default_rng(0).normal(20, 3, 200)
    cell = cells(table({"a": list(values)}))["a"]
    half = 1.96 * values.std() / np.sqrt(len(values))
    assert cell.low == pytest.approx(values.mean() - half, abs=0.1)
    assert cell.high == pytest.approx(values.mean() + half, abs=0.1)


def test_pairing_sees_a_small_steady_lead_that_spread_would_hide():
    spread = np.random.default_rng(1).normal(20, 5, 40)
    steady = cells(table({"a": list(spread + 0.5), "b": list(spread)}))
    assert not steady["b"].tie
    assert steady["b"].behind[0] == pytest.approx(0.5)


def test_a_lead_within_chance_is_a_tie():
    rng = np.random.default_rng(2)
    noisy = cells(table({"a": list(rng.normal(20, 5, 10)), "b": list(rng.normal(20, 5, 10))}))
    assert sorted(c.tie for c in noisy.values()) == [False, True]
    assert "which may be chance" in compare.verdicts(table({"a": [1, 9, 5], "b": [2, 8, 4.9]}))[0]


def test_charts_of_one_view_are_not_independent():
    """Four charts a view, all of a view equal: the interval must be as wide as that of the views alone."""
    views = np.random.default_rng(3).normal(20, 3, 12)
    rows = [
        replace(ROW, metric="psi", view=f"v{v}", region=f"chart{c}", value=value)
        for (v, value), c in itertools.product(enumerate(views), range(4))
    ]
    (by_chart,) = compare.compare(frame(rows))
    cell, alone = cells(by_chart)["m"], cells(table({"m": list(views)}))["m"]
    assert by_chart.columns[0].n_units == 48
    assert cell.high - cell.low == pytest.approx(alone.high - alone.low, rel=0.1)


def test_patches_are_not_counted_beside_their_charts():
    rows = [replace(ROW, metric="psi", region=r, value=v) for r, v in (("c", 10.0), ("c/1-red", 20.0), ("c/2-x", 0.0))]
    (comparison,) = compare.compare(frame(rows))
    assert comparison.columns[0].n_units == 1


def test_one_view_gives_no_interval():
    cell = cells(table({"a": [1.0], "b": [2.0]}))["a"]
    assert np.isnan(cell.low)
    assert not cell.tie


def test_an_unknown_metric_gets_the_nearest_name():
    with pytest.raises(InputError, match=r"no scores of 'psrn'; did you mean 'psnr'"):
        compare.compare(frame([ROW]), ["psrn"])


def test_rows_come_in_the_order_they_were_run():
    assert table({"zebra": [1, 2], "ant": [3, 4]}).rows == ("zebra", "ant")


def test_every_format_holds_every_method():
    comparison = table({"plain": [1, 2, 3], "with_under_score": [2, 3, 4]})
    for how in ("md", "latex", "csv", "json"):
        text = compare.render(comparison, how)
        assert "plain" in text
        assert "with_under_score" in text.replace("\\_", "_")
    assert r"with\_under\_score" in compare.render(comparison, "latex")
    assert "**" in compare.render(comparison, "md")
    assert [line["mean"] for line in json.loads(compare.render(comparison, "json"))] == [2, 3]


def test_folders_of_different_data_are_not_compared(tmp_path):
    for name, data in (("one", "d1"), ("two", "d2")):
        (tmp_path / name).mkdir()
        frame([replace(ROW, method=name, data_id=data)]).to_parquet(tmp_path / name / "scores.parquet")
    with pytest.raises(InputError, match="sea / reef: the data differ between these runs"):
        compare.load([tmp_path / "one", tmp_path / "two"])


def test_one_label_for_two_configurations_is_not_compared(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        frame([replace(ROW, options_id=name)]).to_parquet(tmp_path / name / "scores.parquet")
    with pytest.raises(InputError, match="these folders mean different options by it"):
        compare.load([tmp_path / "one", tmp_path / "two"])
