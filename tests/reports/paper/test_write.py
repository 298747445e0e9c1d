from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from matplotlib.figure import Figure
from support.places import ROOT

from sucre_bench import InputError
from sucre_bench.compare import COSTS
from sucre_bench.compare.text import left_out
from sucre_bench.engine.tasks import base_row
from sucre_bench.errors import NotApplicableError
from sucre_bench.jobs import command
from sucre_bench.jobs.study import FIGURES
from sucre_bench.reports.paper import Study, Written, figures, write
from sucre_bench.reports.paper import follow_option as along
from sucre_bench.results.rows import Row, frame

ROW = Row(scene="reef", metric="psnr", variant="masked", unit="dB", better="higher", code="c", data_id="d")


def row(
    method: str,
    view: str,
    value: float,
    degrade: Mapping[str, Any] = {},
    dataset: Mapping[str, Any] = {"name": "sea"},
    options: Mapping[str, Any] = {},
    **about: Any,
) -> Row:
    """A score as a run keeps it; NaN is a failure."""
    said = {"name": method, "dataset": dict(dataset), **options, **({"degrade": dict(degrade)} if degrade else {})}
    label = ",".join([str(dataset["name"]), *(f"{k}={str(v).replace(', ', '_')}" for k, v in degrade.items())])
    status = {"status": "failed", "reason": "broke"} if np.isnan(value) else {}
    own = {"dataset": label, "method": method, "time": "2026-01-01", **status, **about}
    return replace(ROW, view=view, value=value, options=json.dumps(said), **own)


def noisy(values: Mapping[Any, Mapping[str, list[float]]], option: str = "depth_noise", **about: Any) -> pd.DataFrame:
    """Scores by value, method and view; None is the value of undegraded data, which no row says."""
    return frame(
        row(method, f"v{n}", score, {} if value is None else {option: value}, **about)
        for value, methods in values.items()
        for method, scores in methods.items()
        for n, score in enumerate(scores)
    )


def followed(rows: pd.DataFrame, option: str, **study: Any) -> along.Along:
    (one,) = along.along(rows, Study(name="s", along=option, **study))
    return one


def words(one: along.Along) -> list[str]:
    return [value.word for value in one.values]


def csv(out: Path, name: str = "s") -> pd.DataFrame:
    return pd.read_csv(out / "tables" / f"{name}.csv", keep_default_na=False, na_values=[""])


# -- what a study may be -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"metric": ["psnr"]}, "metrics"),
        ({"metrics": ["pnsr"]}, "did you mean 'psnr'"),
        ({"metrics": ["psnr:maskd"]}, "did you mean 'masked'"),
        ({"metrics": 3}, r"study\.metrics=\[a,b\]"),
        ({"figures": ["score"]}, "did you mean 'scores'"),
        ({"along": "degrade.withn"}, "did you mean 'within'"),
        ({"along": "within"}, "degrade.NAME"),
        ({"baseline": ["a"]}, "is not a word"),
        ({"spread": "yes"}, "is not true or false"),
        ({"name": "../up"}, "no name for files"),
        ({"name": ""}, "no name for files"),
    ],
)
def test_what_is_wrong_with_a_study_is_said(given: dict[str, Any], said: str):
    with pytest.raises(InputError, match=said):
        Study.of({"name": "s", **given})


def test_a_study_takes_one_word_for_a_list_and_null_for_nothing():
    study = Study.of({"name": "s", "metrics": "psnr", "baseline": None, "figures": ["scores"], "along": None})
    assert study == Study("s", metrics=("psnr",), figures=("scores",))


def test_what_a_restoration_costs_may_be_asked_for():
    assert Study.of({"name": "s", "metrics": list(COSTS)}).metrics == COSTS


@pytest.mark.parametrize("path", sorted((ROOT / "conf" / "experiment").glob("*.yaml")), ids=str)
def test_every_experiment_has_a_study_that_can_be_made(path: Path):
    experiment = yaml.safe_load(path.read_text())
    if "study" not in experiment:
        pytest.skip("only restores")
    study = Study.of(experiment["study"])
    computed = {metric.partition(":")[0] for metric in experiment.get("metrics", [])}
    assert not computed or {metric.partition(":")[0] for metric in study.metrics} <= {*computed, *COSTS}
    assert path.stem == study.name == Path(experiment["out"]).name
    assert not study.baseline or study.baseline in experiment["methods"]
    assert not study.along or study.along in experiment["sweep"]


def test_what_an_experiment_sweeps_over_may_be_given():
    sweep = command.jobs(["experiment=degradation", "method=sucre", "degrade.within=50,null"], False)
    assert [(job.dataset.label, job.method.label) for job in sweep.jobs] == [
        ("demo,within=50", "sucre"),
        ("demo", "sucre"),
    ]
    assert all(job.study == Study.of(job.study.__dict__) and job.study.along == "degrade.within" for job in sweep.jobs)


def test_the_ablation_varies_where_water_and_colours_come_from():
    jobs = {job.method.label: job.method.options for job in command.jobs(["experiment=ablation"], False).jobs}
    chosen = {label: (own["water_from"], own["colours"]) for label, own in jobs.items() if "water_from" in own}
    assert chosen == {
        "sucre_multi_view_J": ("seathru", "multi_view"),
        "sucre_multi_view_water": ("", "single_view"),
        "sucre": ("", "multi_view"),
    }


@pytest.mark.parametrize(
    ("swept", "expected"),
    [
        ("degrade.bits=3,null,5", ["3", "5", "none"]),
        ("degrade.depth_noise=0.1,0,0.02", ["0", "0.02", "0.1"]),
        ("dataset.water=turbid,clear", ["turbid", "clear"]),
        ("method.prior=true,false", ["True", "False"]),
    ],
)
def test_what_the_bench_writes_into_rows_is_what_a_study_reads(swept: str, expected: list[str]):
    jobs = command.jobs(["dataset=demo", "method=sucre", swept], True).jobs
    rows = frame(replace(base_row(job), view="v", value=1.0) for job in jobs)
    one = followed(rows, swept.partition("=")[0])
    assert words(one) == expected
    assert (one.title, one.methods) == ("demo", ("sucre",))


# -- tables of methods -------------------------------------------------------------------------------------


def test_a_study_without_an_option_compares_methods_in_the_order_it_is_told(tmp_path: Path):
    rows = frame(
        [
            *(row("a", f"v{n}", 20.0 + n) for n in range(4)),
            *(row("b", f"v{n}", 21.0 + n) for n in range(4)),
            *(row(m, f"v{n}", 0.5, metric="ssim", unit="") for m in "ab" for n in range(4)),
        ]
    )
    written = write(Study("s", metrics=("ssim", "psnr")), rows, tmp_path, methods=("b", "a"))
    assert [path.name for path in written.paths] == ["s.md", "s.tex", "s.csv"]
    assert written.notes == ()
    head, _, first, second = (tmp_path / "tables/s.md").read_text().splitlines()[:4]
    assert head.index("ssim") < head.index("psnr")
    assert first.startswith("| b ")
    assert second.startswith("| a ")
    assert "22.5" in first
    assert "21.5" in second


def test_a_baseline_adds_the_paired_differences_to_it(tmp_path: Path):
    base, other = [20.0, 25.0, 30.0], [21.0, 27.0, 33.0]
    rows = frame([row(m, f"v{n}", v) for m, own in (("a", base), ("b", other)) for n, v in enumerate(own)])
    write(Study("s", baseline="a"), rows, tmp_path)
    told = csv(tmp_path).set_index("method")
    assert told.loc["b", "change"] == pytest.approx(2.0)
    text = (tmp_path / "tables/s.md").read_text()
    assert "27.0 [" in text  # the scores themselves
    assert "+2.00 [" in text  # and how they differ


def test_spread_shows_standard_deviations(tmp_path: Path):
    rows = frame([row("a", f"v{n}", v) for n, v in enumerate([20.0, 22.0])])
    write(Study("s", spread=True), rows, tmp_path)
    assert "21.0 ± 1.00" in (tmp_path / "tables/s.md").read_text()


def test_a_table_for_each_chart_stands_beside_their_mean(tmp_path: Path):
    values = {"near": 10.0, "far": 30.0}
    charts = [row("a", "v0", v, metric="psi", unit="deg", better="lower", region=c) for c, v in values.items()]
    write(Study("s", by="region"), frame(charts), tmp_path)
    assert csv(tmp_path).set_index("table")["mean"].to_dict() == {"sea": 20.0, "sea · near": 10.0, "sea · far": 30.0}
    with pytest.raises(InputError, match=r"study.by: 'regoin' .*'region'"):
        Study.of({"name": "s", "by": "regoin"})


def test_figures_may_be_asked_for_as_svg_too(tmp_path: Path):
    rows = frame([row(m, f"v{n}", n + ord(m)) for m in "ab" for n in range(3)])
    for svg, suffixes in ((True, {".png", ".pdf", ".svg"}), (False, {".png", ".pdf"})):
        write(Study("s", figures=("scores",), svg=svg), rows, tmp_path)
        assert {path.suffix for path in (tmp_path / "figures").iterdir()} == suffixes


def test_figures_of_a_time_with_more_pages_are_cleared_away(tmp_path: Path):
    old, other = tmp_path / "figures/s-scores-9.png", tmp_path / "figures/s-pictures-1.png"
    old.parent.mkdir()
    old.touch()
    other.touch()
    write(
        Study("s", figures=("scores",)), frame([row(m, f"v{n}", n + ord(m)) for m in "ab" for n in range(3)]), tmp_path
    )
    assert not old.exists()
    assert other.exists()


def test_metrics_and_baselines_that_are_not_there_are_notes(tmp_path: Path):
    rows = frame([row("a", "v0", 20.0), row("b", "v0", 21.0)])
    written = write(Study("s", metrics=("psnr", "psi"), baseline="c"), rows, tmp_path)
    assert len(written.paths) == 3
    assert any("no scores of psi" in note for note in written.notes)
    assert any("baseline c did not run" in note for note in written.notes)


def test_where_everything_failed_there_are_no_tables_but_a_note(tmp_path: Path):
    written = write(Study("s", figures=("scores",)), frame([row("a", "v0", np.nan)]), tmp_path)
    assert written.paths == ()
    assert "nothing was restored" in written.notes[0]


# -- tables along an option --------------------------------------------------------------------------------


def test_values_are_read_from_what_rows_say_and_not_from_labels():
    rows = noisy({2: {"a": [1.0]}, 7: {"a": [2.0]}}, option="within").assign(dataset=["sea,within=9", "sea,within=1"])
    assert words(followed(rows, "degrade.within")) == ["2", "7"]


def test_numbers_come_in_their_order_and_what_is_unlimited_last():
    one = followed(noisy({10: {"a": [1.0]}, None: {"a": [1.0]}, 2: {"a": [1.0]}}, option="within"), "degrade.within")
    assert words(one) == ["2", "10", "all"]
    assert one.reference.word == "all"
    assert one.title == "sea"


def test_no_noise_is_the_number_that_it_is_and_the_reference():
    one = followed(noisy({0.1: {"a": [1.0]}, None: {"a": [1.0]}, 0.02: {"a": [1.0]}}), "degrade.depth_noise")
    assert words(one) == ["0", "0.02", "0.1"]
    assert one.reference.word == "0"


def test_words_come_in_the_order_of_the_sweep(tmp_path: Path):
    seas = ["turbid", "clear", "coastal"]
    rows = frame(
        replace(row("a", "v0", 1.0, dataset={"name": "demo", "water": sea}), dataset=f"demo,water={sea}")
        for sea in sorted(seas)
    )
    write(Study("s", along="dataset.water"), rows, tmp_path, datasets=[f"demo,water={sea}" for sea in seas])
    assert list(csv(tmp_path)["water"]) == seas


def test_all_values_are_compared_on_the_images_that_all_have():
    """v1 failed at .1 for b alone: it counts nowhere."""
    rows = noisy({None: {"a": [10, 90, 12], "b": [20, 90, 22]}, 0.1: {"a": [9, 90, 9], "b": [18, np.nan, 18]}})
    one = followed(rows, "degrade.depth_noise", baseline="a")
    means = {line: cell.mean for (line, _), cell in one.scores.cells.items()}
    assert means == {
        "depth_noise=0 · a": 11, "depth_noise=0 · b": 21, "depth_noise=0.1 · a": 9, "depth_noise=0.1 · b": 18,
    }  # fmt: skip
    assert one.changes is not None
    assert one.leads is not None
    changes = {line: cell.change[0] for (line, _), cell in one.changes.cells.items()}
    assert changes == pytest.approx({"depth_noise=0.1 · a": -2, "depth_noise=0.1 · b": -3})
    leads = {line: cell.change[0] for (line, _), cell in one.leads.cells.items()}
    assert leads == pytest.approx({"depth_noise=0 · b": 10, "depth_noise=0.1 · b": 9})


def test_a_change_that_is_steady_is_told_from_chance_where_scores_vary_widely():
    scores = np.random.default_rng(0).normal(20, 6, 12)
    less = scores - np.random.default_rng(1).normal(1, 0.2, 12)
    one = followed(noisy({None: {"a": list(scores)}, 0.1: {"a": list(less)}}), "degrade.depth_noise")
    assert one.changes is not None
    (cell,) = one.changes.cells.values()
    assert cell.change[0] == pytest.approx((less - scores).mean())
    assert cell.change[2] < 0
    (column,) = one.scores.columns
    undegraded, degraded = (one.scores.cells[line, column] for line in one.scores.methods)
    assert undegraded.low < degraded.mean < undegraded.high  # unpaired, nothing could be said


def test_results_on_older_data_are_left_out_and_said():
    rows = noisy({None: {"a": [10.0, 12.0], "b": [20.0, 22.0]}, 0.1: {"a": [9.0, 9.0], "b": [18.0, 18.0]}})
    old = (rows["method"] == "b") & (rows["dataset"] == "sea")
    rows = rows.assign(data_id=rows["data_id"].mask(old, "old"), time=rows["time"].mask(old, "2025-12-31"))
    one = followed(rows, "degrade.depth_noise")
    assert one.scores.stale == ("depth_noise=0 · b",)
    assert "depth_noise=0 · b" not in {line for line, _ in one.scores.cells}


def test_repetitions_are_averaged_and_are_no_views_of_their_own():
    rows = noisy({None: {"a": [10.0, 12.0]}, 0.1: {"a": [8.0, 8.0]}})
    again = noisy({None: {"a": [20.0, 22.0]}, 0.1: {"a": [8.0, 8.0]}}, scene="reef,replicate=1")
    one = followed(pd.concat([rows, again], ignore_index=True), "degrade.depth_noise")
    (column,) = one.scores.columns
    assert (column.n_views, column.n_scenes) == (2, 1)
    assert one.scores.cells["depth_noise=0 · a", column].mean == 16


@pytest.mark.parametrize("repetitions", [("",), ("", ",replicate=1")])
def test_scenes_called_after_a_datasets_option_are_paired_by_their_views(repetitions: tuple[str, ...]):
    rows = frame(
        replace(
            row("a", f"v{n}", value + n, dataset={"name": "demo", "water": water}),
            dataset=f"demo,water={water}", scene=water + repetition, data_id=water,
        )
        for water, value in (("clear", 20.0), ("turbid", 15.0))
        for repetition in repetitions
        for n in range(3)
    )  # fmt: skip
    one = followed(rows, "dataset.water")
    assert one.changes is not None
    assert [cell.change for cell in one.changes.cells.values()] == [pytest.approx((-5, -5, -5))]


def test_every_dataset_has_tables_of_its_own(tmp_path: Path):
    both = [noisy({None: {"a": [1.0]}, 0.1: {"a": [2.0]}}, dataset={"name": name}) for name in ("sea", "lake")]
    write(Study("s", along="degrade.depth_noise"), pd.concat(both, ignore_index=True), tmp_path)
    assert list(csv(tmp_path)["dataset"]) == ["sea", "sea", "lake", "lake"]
    assert "**lake**" in (tmp_path / "tables/s.md").read_text()


def test_a_method_without_the_option_is_left_out_and_said():
    rows = frame(
        [
            *(replace(row("m", "v0", 1.0, options={"k": k}), method=f"m,k={k}") for k in (1, 2)),
            row("plain", "v0", 3.0),
        ]
    )
    one = followed(rows, "method.k")
    assert (words(one), one.methods) == (["1", "2"], ("m",))
    assert "plain is left out: it has no option k" in left_out(one.scores)


def test_an_option_that_nothing_has_is_not_applicable(tmp_path: Path):
    rows = frame([row("m", "v0", 1.0, options={"steps": 1})])
    with pytest.raises(NotApplicableError, match="did you mean 'steps'"):
        followed(rows, "method.step")
    written = write(Study("s", along="method.step"), rows, tmp_path)
    assert written.paths == ()
    assert "no tables" in written.notes[0]


def test_added_waters_are_told_by_their_attenuation():
    waters = [[0.1, 0.2, 0.3, *beta, 0.1, 0.1, 0.1] for beta in ([0.9, 0.3, 0.3], [0.2, 0.1, 0.0])]
    rows = frame(row("a", "v0", 1.0, {"add_water": water}) for water in waters)
    assert words(followed(rows, "degrade.add_water")) == ["0.1", "0.5"]


def test_different_waters_of_one_attenuation_are_not_mixed():
    waters = [[B, 0.2, 0.3, 0.2, 0.1, 0.3, 0.1, 0.1, 0.1] for B in (0.1, 0.4)]
    rows = frame(row("a", "v0", 10 * B[0], {"add_water": B}) for B in waters)
    one = followed(rows, "degrade.add_water")
    assert len(set(words(one))) == 2
    assert sorted(cell.mean for cell in one.scores.cells.values()) == pytest.approx([1, 4])


# -- files -------------------------------------------------------------------------------------------------


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Give `draw` functions the names of figures."""

    def add(name: str, draw: Any) -> None:
        module = ModuleType(f"sucre_bench.reports.paper.figures.{name}")
        module.draw = draw  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, module.__name__, module)

    return add


def test_a_figure_that_breaks_costs_no_other(tmp_path: Path, drawn: Any):
    def breaks(results: object) -> Iterator[Any]:
        raise ZeroDivisionError("by nought")
        yield

    def nothing(results: object) -> Iterator[Any]:
        raise NotApplicableError("no charts; add some")
        yield

    def half(results: object) -> Iterator[Any]:
        yield "sea", NotApplicableError("no charts in the sea; add some")
        yield "lake", Figure()

    drawn("breaks", breaks)
    drawn("nothing", nothing)
    drawn("half", half)
    rows = frame([row(m, f"v{n}", 20.0 + n + (m == "b")) for m in "ab" for n in range(2)])
    written = write(Study("s", figures=("breaks", "nothing", "half", "scores")), rows, tmp_path)
    names = {f"s-{name}.{suffix}" for name in ("scores", "half-lake") for suffix in ("png", "pdf")}
    assert {path.name for path in written.paths if path.parent.name == "figures"} == names
    assert "s-breaks: failed, ZeroDivisionError: by nought" in written.notes[0]
    assert "by nought" in (tmp_path / "logs/failures.log").read_text()
    assert written.notes[1:] == (
        "s-nothing: not drawn, no charts; add some",
        "s-half: not drawn, no charts in the sea; add some",
    )


def test_a_study_of_scores_that_nothing_has_writes_no_tables_and_leaves_no_old_ones(tmp_path: Path, drawn: Any):
    def draws(results: object) -> Iterator[Any]:
        yield "", Figure()  # of what methods told, say

    drawn("draws", draws)
    rows = frame([row(m, f"v{n}", 20.0 + n) for m in "ab" for n in range(2)])
    assert len(write(Study("s", metrics=("psnr",)), rows, tmp_path).paths) == 3
    written = write(Study("s", metrics=("psi", "de00:lab"), figures=("draws",)), rows, tmp_path)
    assert written.notes == (
        "s: no scores of psi, de00:lab, left out",
        "s: no tables, no requested metric has a score",
    )
    assert {path.name for path in written.paths} == {"s-draws.png", "s-draws.pdf"}
    assert not list((tmp_path / "tables").iterdir())


def test_where_nothing_was_restored_nothing_of_before_is_left(tmp_path: Path):
    rows = frame([row(m, f"v{n}", 20.0 + n) for m in "ab" for n in range(2)])
    study = Study("s", figures=("scores",))
    (tmp_path / "figures").mkdir()
    other = tmp_path / "figures" / "s-2-scores.png"
    other.write_bytes(b"of another study")
    write(study, rows, tmp_path)
    failed = rows.assign(status="failed", reason="boom", value=float("nan"))
    assert write(study, failed, tmp_path) == Written((), ("s: nothing was restored, so there is nothing to show",))
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [other]


def test_the_same_rows_in_any_order_make_the_same_files(tmp_path: Path):
    rng = np.random.default_rng(3)
    scores = {None: {m: list(rng.normal(20, 2, 5)) for m in "ab"}, 0.1: {m: list(rng.normal(18, 2, 5)) for m in "ab"}}
    rows = noisy(scores)
    study = Study("s", along="degrade.depth_noise", baseline="a", figures=("against",))
    order = {"methods": ("a", "b"), "datasets": ("sea", "sea,depth_noise=0.1")}
    first = write(study, rows, tmp_path / "1", **order)
    second = write(study, rows.sample(frac=1, random_state=0), tmp_path / "2", **order)
    assert [p.name for p in first.paths] == [p.name for p in second.paths]
    assert len(first.paths) == 5
    for one, other in zip(first.paths, second.paths, strict=True):
        assert one.read_bytes() == other.read_bytes(), one.name


def test_tables_for_papers_balance_their_braces(tmp_path: Path):
    write(Study("s", along="degrade.depth_noise"), noisy({None: {"a_b": [1.0]}, 0.1: {"a_b": [2.0]}}), tmp_path)
    text = (tmp_path / "tables/s.tex").read_text()
    assert text.count("{") == text.count("}")
    assert r"depth\_noise=0.1 $\cdot$ a\_b" in text


def test_figures_are_found_by_name():
    assert all(callable(figures.find(name)) for name in FIGURES)
    assert {path.stem for path in Path(figures.__file__).parent.glob("*.py")} - set(FIGURES) == {"__init__", "style"}
