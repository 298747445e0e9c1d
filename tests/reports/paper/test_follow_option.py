"""Tables along an option."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.made_results import followed, noisy, row, words

from sucre_bench.compare.words import left_out
from sucre_bench.errors import NotApplicableError
from sucre_bench.reports.paper import Study, write
from sucre_bench.results.rows import frame


def test_values_are_read_from_what_rows_say_and_not_from_labels():
    rows = noisy({2: {"a": [1.0]}, 7: {"a": [2.0]}}, option="within").assign(
        dataset=["sea,within=9", "sea,within=1"]
    )
    assert words(followed(rows, "degrade.within")) == ["2", "7"]


def test_all_values_are_compared_on_the_images_that_all_have():
    """v1 failed at .1 for b alone: it counts nowhere."""
    rows = noisy(
        {
            None: {"a": [10, 90, 12], "b": [20, 90, 22]},
            0.1: {"a": [9, 90, 9], "b": [18, np.nan, 18]},
        }
    )
    one = followed(rows, "degrade.depth_noise", baseline="a")
    means = {line: cell.mean for (line, _), cell in one.scores.cells.items()}
    assert means == {
        "depth_noise=0 · a": 11, "depth_noise=0 · b": 21, "depth_noise=0.1 · a": 9, "depth_noise=0.1 · b": 18,
    }  # fmt: skip
    changes = {line: cell.change[0] for (line, _), cell in one.changes.cells.items()}
    assert changes == pytest.approx({"depth_noise=0.1 · a": -2, "depth_noise=0.1 · b": -3})
    leads = {line: cell.change[0] for (line, _), cell in one.leads.cells.items()}
    assert leads == pytest.approx({"depth_noise=0 · b": 10, "depth_noise=0.1 · b": 9})


def test_results_on_older_data_are_left_out_and_said():
    rows = noisy(
        {
            None: {"a": [10.0, 12.0], "b": [20.0, 22.0]},
            0.1: {"a": [9.0, 9.0], "b": [18.0, 18.0]},
        }
    )
    old = (rows["method"] == "b") & (rows["dataset"] == "sea")
    rows = rows.assign(
        data_id=rows["data_id"].mask(old, "old"), time=rows["time"].mask(old, "2025-12-31")
    )
    one = followed(rows, "degrade.depth_noise")
    assert any(said.endswith("depth_noise=0 · b") for said in left_out(one.scores))
    assert "depth_noise=0 · b" not in {line for line, _ in one.scores.cells}


@pytest.mark.parametrize("repetitions", [("",), ("", ",replicate=1")])
def test_scenes_called_after_a_datasets_option_are_paired_by_their_views(
    repetitions: tuple[str, ...],
):
    rows = frame(
        replace(
            row("a", f"v{n}", value + n, dataset={"name": "demo", "water": water}),
            dataset=f"demo,water={water}", scene=water + repetition, data_id=water,
        )
        for water, value in (("clear", 20.0), ("turbid", 15.0))
        for repetition in repetitions
        for n in range(5)
    )  # fmt: skip
    one = followed(rows, "dataset.water")
    assert [cell.change for cell in one.changes.cells.values()] == [pytest.approx((-5, -5, -5))]


def test_each_level_has_a_best_of_its_own_and_methods_are_lines(tmp_path: Path):
    """Nobody compares methods at unlike noise: b is best without it, a with it."""
    scores = {None: {"a": [10.0, 12], "b": [20.0, 22]}, 0.1: {"a": [9.0, 9], "b": [8.0, 8]}}
    write(Study("s", along="degrade.depth_noise"), noisy(scores), tmp_path)
    table = (tmp_path / "tables/s.tex").read_text().partition(r"\end{tabular}")[0]
    lines = [line.split(" & ") for line in table.splitlines() if " & " in line]
    assert [line[0] for line in lines] == ["method", "a", "b", "views"]
    assert [[r"\textbf" in cell for cell in line[1:]] for line in lines[1:-1]] == [
        [False, True],
        [True, False],
    ]


def test_an_option_that_nothing_has_is_not_applicable(tmp_path: Path):
    rows = frame([row("m", "v0", 1.0, options={"steps": 1})])
    with pytest.raises(NotApplicableError, match="'steps'"):
        followed(rows, "method.step")
    written = write(Study("s", along="method.step"), rows, tmp_path)
    assert written.paths == ()
    assert "tables: not made" in written.notes[0]


def test_different_waters_of_one_attenuation_are_not_mixed():
    waters = [[B, 0.2, 0.3, 0.2, 0.1, 0.3, 0.1, 0.1, 0.1] for B in (0.1, 0.4)]
    rows = frame(row("a", "v0", 10 * B[0], {"add_water": B}) for B in waters)
    one = followed(rows, "degrade.add_water")
    assert len(set(words(one))) == 2
    assert sorted(cell.mean for cell in one.scores.cells.values()) == pytest.approx([1, 4])
