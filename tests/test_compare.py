from __future__ import annotations

import io
import itertools
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from sucre_bench import InputError, compare, tables
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
    assert comparison.methods == ("a", "b")
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
    assert "which may be chance" in tables.verdicts(table({"a": [1, 9, 5], "b": [2, 8, 4.9]}))[0]


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
    assert table({"zebra": [1, 2], "ant": [3, 4]}).methods == ("zebra", "ant")


def test_every_format_holds_every_method():
    comparison = table({"plain": [1, 2, 3], "with_under_score": [2, 3, 4]})
    for how in ("md", "latex", "csv", "json"):
        text = tables.as_text([comparison], how)
        assert "plain" in text
        assert "with_under_score" in text.replace("\\_", "_")
    assert r"with\_under\_score" in tables.as_text([comparison], "latex")
    assert "**" in tables.as_text([comparison], "md")
    assert [line["mean"] for line in json.loads(tables.as_text([comparison], "json"))] == [2, 3]


def test_several_tables_are_one_text_a_program_can_read():
    both = compare.compare(frame([ROW, replace(ROW, dataset="lake")]))
    assert [line["table"] for line in json.loads(tables.as_text(both, "json"))] == ["sea", "lake"]
    assert tables.as_text(both, "csv").count("metric,variant") == 1
    assert "**lake**" in tables.as_text(both, "md")


def test_labels_are_shown_as_they_are():
    """Square brackets mean colours to the terminal's library, backslashes and braces something to LaTeX."""
    comparison = table({"w=[abc]": [1, 2], "a{b}_[/red]": [3, 4]})
    console = Console(file=io.StringIO(), width=120)
    console.print(tables.as_table(comparison, 120))
    assert "w=[abc]" in console.file.getvalue()
    assert "a{b}_[/red]" in console.file.getvalue()
    assert r"a\{b\}\_" in tables.as_text([comparison], "latex")


@pytest.mark.parametrize("n", [2, 3, 4, 8])
def test_equal_methods_are_rarely_told_apart_however_few_the_views(n: int):
    """95 % intervals: of equal methods, one pair in twenty may be called different."""
    rng = np.random.default_rng(n)
    views = pd.MultiIndex.from_tuples([("reef", f"v{i}", "image") for i in range(n)], names=compare._UNIT)
    told_apart = 0
    for _ in range(300):
        values = pd.DataFrame(rng.normal(size=(n, 2)), columns=["a", "b"], index=views)
        told_apart += not any(cell.tie for cell in compare._cells(values, lower_is_better=False).values())
    assert told_apart / 300 < 0.1


def test_a_mean_lies_in_its_interval_however_many_charts_a_view_has():
    rows = [replace(ROW, view=f"v{v}", region="c0", value=10.0 + v % 3) for v in range(6)]
    rows += [replace(ROW, view="v9", region=f"c{c}", value=40.0) for c in range(20)]
    (comparison,) = compare.compare(frame(rows))
    cell = cells(comparison)["m"]
    assert cell.low < cell.mean < cell.high


def test_an_infinite_score_is_shown_and_claims_nothing():
    """A perfect restoration has an infinite PSNR."""
    comparison = table({"perfect": [np.inf, 30.0], "good": [29.0, 28.0]})
    assert cells(comparison)["perfect"].mean == np.inf
    assert not np.isfinite(cells(comparison)["perfect"].low)
    assert tables.verdicts(comparison) == []
    assert "inf ± -" in tables._plain(cells(comparison)["perfect"])


def test_methods_that_ran_on_older_data_are_left_out_and_named():
    rows = [replace(ROW, method="old", data_id="d1"), replace(ROW, method="new", data_id="d2", time="2026-01-02")]
    (comparison,) = compare.compare(frame(rows))
    assert (comparison.methods, comparison.stale) == (("new",), ("old",))
    assert "left out, for they ran on other data: old" in tables.as_text([comparison], "md")


def test_by_view_ranks_methods_within_each_view():
    scores = (("a", "v0", 9), ("b", "v0", 8), ("a", "v1", 1), ("b", "v1", 2))
    first, second = compare.compare(frame([replace(ROW, method=m, view=v, value=x) for m, v, x in scores]), by="view")
    assert (first.title, second.title) == ("sea · v0", "sea · v1")
    assert (cells(first)["a"].rank, cells(second)["a"].rank) == (1, 2)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0"), (0.0002, "0.00020"), (0.02, "0.020"), (0.0312, "0.031"), (0.5, "0.500"), (1.234, "1.23"),
        (31.74, "31.7"), (123.4, "123"), (np.nan, "-"), (np.inf, "inf"), (-12.34, "-12.3"),
    ],
)  # fmt: skip
def test_numbers_keep_the_figures_that_matter(value: float, text: str):
    assert tables.number(value) == text


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
