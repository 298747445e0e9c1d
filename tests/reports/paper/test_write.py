"""What a study writes: tables of methods, figures, and notes on what is missing."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from support.made_results import csv, noisy, row

from sucre_bench import InputError
from sucre_bench.errors import NotApplicableError
from sucre_bench.reports.paper import Study, write, write_study
from sucre_bench.results.rows import frame

# -- tables of methods -----------------------------------------------------------------------------------


def test_a_study_without_an_option_compares_methods_in_the_order_it_is_told(tmp_path: Path):
    half = [0.5] * 4
    rows = pd.concat(
        [
            noisy({None: {"a": [20.0, 21, 22, 23], "b": [21.0, 22, 23, 24]}}),
            noisy({None: {"a": half, "b": half}}, metric="ssim", unit=""),
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
    base, other = [20.0, 25.0, 30.0, 25, 25], [21.0, 27.0, 33.0, 28, 26]
    rows = noisy({None: {"a": base, "b": other}})
    write(Study("s", baseline="a"), rows, tmp_path)
    told = csv(tmp_path).set_index("method")
    assert told.loc["b", "change"] == pytest.approx(2.0)
    text = (tmp_path / "tables/s.md").read_text()
    assert "27.0 [" in text  # the scores themselves
    assert "+2.00 [" in text  # and how they differ


def test_a_table_for_each_chart_stands_beside_their_mean(tmp_path: Path):
    values = {"near": 10.0, "far": 30.0}
    charts = [
        row("a", "v0", v, metric="psi", unit="deg", better="lower", region=c)
        for c, v in values.items()
    ]
    write(Study("s", by="region"), frame(charts), tmp_path)
    assert csv(tmp_path).set_index("table")["mean"].to_dict() == {
        "sea": 20.0,
        "sea · near": 10.0,
        "sea · far": 30.0,
    }
    with pytest.raises(InputError, match=r"study.by: 'regoin' .*'region'"):
        Study.of({"name": "s", "by": "regoin"})


def test_metrics_and_baselines_that_are_not_there_are_notes(tmp_path: Path):
    rows = frame([row("a", "v0", 20.0), row("b", "v0", 21.0)])
    written = write(Study("s", metrics=("psnr", "psi"), baseline="c"), rows, tmp_path)
    assert len(written.paths) == 3
    assert any(" psi" in note for note in written.notes)
    assert any("baseline c " in note for note in written.notes)


# -- files -----------------------------------------------------------------------------------------------


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Give `draw` functions the names of figures."""

    def add(name: str, draw: Any) -> None:
        monkeypatch.setitem(write_study.MODULES, name, "scores")
        monkeypatch.setattr(f"sucre_bench.reports.paper.scores.{name}", draw, raising=False)

    return add


def test_a_figure_that_breaks_costs_no_other(tmp_path: Path, drawn: Any):
    from matplotlib.figure import Figure

    def breaks(results: object) -> Iterator[Any]:
        raise ZeroDivisionError("by nought")
        yield

    def nothing(results: object) -> Iterator[Any]:
        raise NotApplicableError("no charts; add some")
        yield

    def half(results: object) -> Iterator[Any]:
        yield ("sea",), NotApplicableError("no charts in the sea; add some")
        yield ("lake",), Figure()

    drawn("breaks", breaks)
    drawn("nothing", nothing)
    drawn("half", half)
    rows = noisy({None: {"a": [20.0, 21], "b": [21.0, 22]}})
    written = write(Study("s", figures=("breaks", "nothing", "half", "scores")), rows, tmp_path)
    names = {
        f"s-{name}.{suffix}" for name in ("scores", "half-lake") for suffix in ("png", "pdf")
    }
    assert {path.name for path in written.paths if path.parent.name == "figures"} == names
    assert "s-breaks: failed, ZeroDivisionError: by nought" in written.notes[0]
    assert "by nought" in (tmp_path / "logs/failures.log").read_text()
    for note, name, reason in zip(
        written.notes[1:],
        ("nothing", "half"),
        ("no charts;", "no charts in the sea;"),
        strict=True,
    ):
        assert note.startswith(f"s-{name}: ")
        assert reason in note


def test_where_nothing_was_restored_nothing_of_before_is_left(tmp_path: Path):
    rows = noisy({None: {"a": [20.0, 21], "b": [20.0, 21]}})
    study = Study("s", figures=("scores",))
    (tmp_path / "figures").mkdir()
    other = tmp_path / "figures" / "s-2-scores.png"
    other.write_bytes(b"of another study")
    write(study, rows, tmp_path)
    failed = rows.assign(status="failed", reason="boom", value=float("nan"))
    written = write(study, failed, tmp_path)
    assert (written.paths, [note.partition(":")[0] for note in written.notes]) == ((), ["s"])
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [other]


def test_the_same_rows_in_any_order_make_the_same_files(tmp_path: Path):
    rng = np.random.default_rng(3)
    scores = {
        None: {m: list(rng.normal(20, 2, 5)) for m in "ab"},
        0.1: {m: list(rng.normal(18, 2, 5)) for m in "ab"},
    }
    rows = noisy(scores)
    study = Study("s", along="degrade.depth_noise", baseline="a", figures=("against",))
    order = {"methods": ("a", "b"), "datasets": ("sea", "sea,depth_noise=0.1")}
    first = write(study, rows, tmp_path / "1", **order)
    second = write(study, rows.sample(frac=1, random_state=0), tmp_path / "2", **order)
    assert [p.name for p in first.paths] == [p.name for p in second.paths]
    assert len(first.paths) == 5
    for one, other in zip(first.paths, second.paths, strict=True):
        assert one.read_bytes() == other.read_bytes(), one.name
