"""Plugins that end, block or break their process: their view fails, the other views go on, the command ends."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support.command_line import Done, Started, run_here, run_program
from support.places import TOYS

from sucre_bench import results
from sucre_bench.errors import DiedError

PLUGINS = str(TOYS)


def words(acts: str, *more: str) -> list[str]:
    fixed = [
        "run",
        "--plugin",
        PLUGINS,
        "dataset=acts",
        f"dataset.acts=[{acts}]",
        "tracking.uri=off",
        "report=false",
    ]
    return [*fixed, "out=results", *more]


def restorations(folder: Path, method: str = "actor") -> pd.DataFrame:
    rows = results.read(folder / "results")
    return rows[(rows["metric"] == "seconds") & (rows["method"] == method)].set_index("view")


def check(done: Done, folder: Path, acts: str, said: dict[str, str]) -> None:
    """Each act's view has failed with its reason, the views around them are done, and little was printed."""
    rows = restorations(folder)
    for act in acts.split(","):
        assert rows.loc[f"{act}.png", "status"] == "failed", act
        assert said[act] in rows.loc[f"{act}.png", "reason"]
        assert len(rows.loc[f"{act}.png", "reason"]) < 3000
    assert rows.loc[["before.png", "after.png"], "status"].tolist() == ["ok", "ok"]
    assert done.returncode == 1
    assert "Traceback" not in done.stdout + done.stderr
    assert len((done.stdout + done.stderr).splitlines()) < 60


DEATHS = {
    "exit": "exit code 0",
    "segfault": "signal 11",
    "abort": "signal 6",
    "child": "signal 9",  # a process that it forked lives on
    "daemon": "exit code 3",
    "junk": "exit code 0",  # it has written into the pipe to the command
}


def test_a_view_at_which_the_process_dies_fails_and_the_rest_of_the_sweep_goes_on(
    tmp_path: Path,
):
    acts = ",".join(DEATHS)
    sweep = words(acts, "-m", "method=actor,gray_world", "metrics=[coverage]", "workers=2")
    done = Started(tmp_path, *sweep).ended()
    check(
        done, tmp_path, acts, {act: f"the process died ({how}" for act, how in DEATHS.items()}
    )
    assert set(restorations(tmp_path, "gray_world")["status"]) == {"ok"}
    before = restorations(tmp_path)["time"].to_dict()

    again = run_here(tmp_path, *sweep)  # would end this process if it tried them again
    assert again.returncode == 1
    assert restorations(tmp_path)["time"].to_dict() == before


ACTOR = words("fine", "method=actor", "metrics=[coverage]")


@pytest.fixture(scope="module")
def died_at_fine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results as a process leaves them that died at fine.png."""
    folder = tmp_path_factory.mktemp("died")
    run_here(folder, *ACTOR)
    table = folder / "results" / "scores.parquet"
    rows = pd.read_parquet(table)
    died = rows["view"] == "fine.png"
    rows.loc[died, ["status", "reason", "value"]] = [
        "failed",
        str(DiedError("signal 11", "method 'actor'")),
        np.nan,
    ]
    rows[~died | (rows["metric"] == "seconds")].to_parquet(table)
    return folder / "results"


@pytest.mark.parametrize(
    ("overwrite", "again"),
    [
        ("missing", set()),
        ("never", set()),
        ("failed", {"fine.png"}),
        ("always", {"before.png", "fine.png", "after.png"}),
    ],
)
def test_a_view_at_which_a_process_died_is_tried_again_only_if_asked(
    died_at_fine: Path, tmp_path: Path, overwrite: str, again: set[str]
):
    shutil.copytree(died_at_fine, tmp_path / "results")
    before = restorations(tmp_path)["time"].to_dict()
    done = run_here(tmp_path, *ACTOR, f"overwrite={overwrite}")
    after = restorations(tmp_path)["time"].to_dict()
    assert {view for view in before if after[view] != before[view]} == again
    assert done.returncode == (0 if again else 1)


FAULTS = {
    "asleep-in-c": "view_timeout_s",  # no exception can end it
    "deaf": "view_timeout_s",
    "asleep": "view_timeout_s",
    "outside": "Outside: away",
    "generator-exit": "GeneratorExit",
    "long": "ValueError: xxx",
    "reload": "PicklingError",
}


def test_a_view_that_fails_or_comes_to_no_end_costs_itself(tmp_path: Path):
    """One view leaves a thread behind that sleeps for an hour. The command ends all the same."""
    acts = ",".join(FAULTS)
    told = f"3 ok, {len(FAULTS)} failed, 0 skipped"
    # seconds that views which do nothing are given; the next on a busy machine
    for limit_s in (2, 20, 200):
        folder = tmp_path / str(limit_s)
        folder.mkdir()
        limited = words(
            f"{acts},thread", "method=actor", "metrics=[coverage]", f"view_timeout_s={limit_s}"
        )
        done = Started(folder, *limited).ended()
        if told in done.stdout:
            break
    check(done, folder, acts, FAULTS)
    assert told in done.stdout
    assert f"view_timeout_s={limit_s};" in restorations(folder).loc["asleep.png", "reason"]


def test_text_that_is_no_utf8_costs_its_view_alone(tmp_path: Path):
    acts = "odd-text,odd-device"
    sweep = words(
        f"odd-hint,{acts}", "-m", "method=actor,gray_world", "metrics=[coverage]", "report=true"
    )
    done = run_here(tmp_path, *sweep)
    check(
        done,
        tmp_path,
        acts,
        {"odd-text": r"caf\udce9.png is bad", "odd-device": r"device 'caf\udce9'"},
    )
    assert set(restorations(tmp_path, "gray_world")["status"]) == {"ok"}
    (log,) = (tmp_path / "results").rglob("*.log")
    assert r"caf\udce9.png is bad" in log.read_text(encoding="utf-8")


HARMS = ("libraries", "leaks", "late-segfault")


@pytest.mark.parametrize("harm", HARMS)
def test_what_a_view_does_to_its_process_is_no_matter_to_other_methods(
    tmp_path: Path, harm: str
):
    sweep = words(harm, "-m", "method=actor,gray_world", "metrics=[coverage]")
    done = Started(tmp_path, *sweep).ended()
    assert done.returncode in (0, 1), done.stderr
    assert "Traceback" not in done.stdout + done.stderr
    other = restorations(tmp_path, "gray_world")
    assert other["status"].to_dict() == {
        "before.png": "ok",
        f"{harm}.png": "ok",
        "after.png": "ok",
    }
    rows = restorations(tmp_path)
    assert set(rows.index) == {"before.png", f"{harm}.png", "after.png"}, "each view has a row"
    assert rows.loc["before.png", "status"] == "ok"


def test_a_view_that_removes_its_folder_costs_no_view(tmp_path: Path):
    done = Started(
        tmp_path, *words("removed-folder,elsewhere", "method=actor", "metrics=[coverage]")
    ).ended()
    assert done.returncode == 0, done.stderr
    assert "4 ok, 0 failed" in done.stdout


def test_jobs_of_joblib_lose_no_more_than_the_view_at_which_one_dies(tmp_path: Path):
    at_once = ("hydra/launcher=joblib", "hydra.launcher.n_jobs=2")
    sweep = words("segfault", "-m", "method=actor,gray_world", "metrics=[coverage]", *at_once)
    # A program by itself: joblib's processes outlive a forked command by 300 s.
    done = run_program(tmp_path, *sweep)
    check(done, tmp_path, "segfault", {"segfault": "the process died (signal 11)"})
    assert set(restorations(tmp_path, "gray_world")["status"]) == {"ok"}


def test_a_score_at_which_the_process_dies_fails_alone(tmp_path: Path):
    done = Started(
        tmp_path, *words("fine", "method=actor", "metrics=[coverage,critic]")
    ).ended()
    rows = results.read(tmp_path / "results").set_index(["metric", "view"])
    assert "exit code 7" in rows.loc[("critic", "after.png"), "reason"]
    assert rows.loc[("critic", "fine.png"), "value"] == 0.5
    assert set(rows.loc[["coverage", "seconds"], "status"]) == {"ok"}
    assert done.returncode == 1


@pytest.mark.parametrize("region", ["image", "patch 7"])
def test_two_scores_of_one_region_are_none(tmp_path: Path, region: str):
    metrics = ("metrics=[coverage,twice]", f"metrics.twice.region={region}")
    done = run_here(tmp_path, *words("fine", "method=actor", *metrics))
    rows = results.read(tmp_path / "results").set_index("metric")
    assert set(rows.loc["twice", "status"]) == {"failed"}
    assert f"'{region}'" in rows.loc["twice", "reason"].iloc[0]
    assert set(rows.loc["coverage", "status"]) == {"ok"}
    assert done.returncode == 1


@pytest.mark.parametrize(("kind", "name"), [("view", "''"), ("view", "./"), ("scene", "/")])
def test_a_view_or_scene_without_a_name_is_one_line_that_names_the_dataset(
    tmp_path: Path, kind: str, name: str
):
    called = ("dataset=called", f"dataset.{kind}={name}", "method=gray_world")
    done = run_here(tmp_path, "run", "--plugin", PLUGINS, *called)
    assert done.returncode == 2
    (line,) = done.errors
    assert "dataset 'called'" in line
    assert kind in line
