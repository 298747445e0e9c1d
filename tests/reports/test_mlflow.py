"""Tells mlflow about a command: while it runs, and later. Also where the stores of mlflow are."""

import json
import re
import shutil
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from support.command_line import Started, calls
from support.made_results import row
from support.places import TOYS

from sucre_bench import compare, results
from sucre_bench.errors import OutputError
from sucre_bench.reports.mlflow.runs import log
from sucre_bench.reports.mlflow.store import Place
from sucre_bench.reports.paper import style

pytestmark = pytest.mark.usefixtures("toys")
PASSWORD = "pa55word"
SECONDS = {"metric": "seconds", "variant": "wall", "unit": "s", "better": "lower"}
RUN = ("run", "--plugin", str(TOYS), "dataset=toy", "metrics=[redness]", "report=false")


def asked(uri: str) -> Any:
    """What asks a store. mlflow is imported here: the search for tests would take a second longer in each process."""
    from mlflow import MlflowClient

    return MlflowClient(tracking_uri=uri)


def runs(uri: str, experiment: str = "sucre_bench") -> list:
    client = asked(uri)
    experiments = [e.experiment_id for e in client.search_experiments() if e.name == experiment]
    return client.search_runs(experiments) if experiments else []


def by_method(uri: str) -> dict[str, Any]:
    """The runs by method; the parent's is "". Each is there once."""
    found = runs(uri)
    named = {run.data.tags.get("method", ""): run for run in found}
    assert len(named) == len(found)
    return named


def steps(uri: str, run: Any) -> dict[int, list[float]]:
    """The values of each step."""
    found: dict[int, list[float]] = {}
    for point in asked(uri).get_metric_history(run.info.run_id, "views/redness.plain"):
        found.setdefault(point.step, []).append(point.value)
    return found


def artifacts(run: Any) -> Path:
    return Path(run.info.artifact_uri.removeprefix("file://"))


@pytest.fixture(scope="session")
def empty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An empty store, which takes mlflow seconds to make."""
    folder = tmp_path_factory.mktemp("empty")
    asked(f"sqlite:///{folder / 'mlflow.db'}").search_experiments()
    return folder / "mlflow.db"


@pytest.fixture
def out(tmp_path: Path, empty: Path) -> Path:
    """A results folder with an empty store."""
    (tmp_path / "out").mkdir()
    shutil.copy(empty, tmp_path / "out" / "mlflow.db")
    return tmp_path / "out"


@pytest.fixture
def uri(out: Path) -> str:
    return f"sqlite:///{out / 'mlflow.db'}"


# -- while a command runs ----------------------------------------------------------------------------------


def waited_for(look: Callable[[], Any]) -> Any:
    deadline = time.monotonic() + 300
    while not (found := look()):
        assert time.monotonic() < deadline
        time.sleep(0.3)
    return found


def test_runs_are_there_while_a_view_is_restored_killed_at_ctrl_c_and_go_on_without_doubles(
    out: Path, uri: str, tmp_path: Path
):
    log, method = (
        tmp_path / "log",
        ("method=gain,gain2", "gain.stays_at=v2.png", f"gain.log={tmp_path / 'log'}"),
    )
    words = ("run", "-m", *RUN[1:], *method, f"out={out}", "degrade.noise=0")
    stopped = Started(tmp_path, *words)
    waited_for(lambda: "v2.png" in calls(log))  # where it stays until it is stopped
    gain = waited_for(
        lambda: (found := by_method(uri).get("gain")) and len(steps(uri, found)) == 2 and found
    )
    at_work = by_method(uri)
    assert {name: run.info.status for name, run in at_work.items()} == {
        "": "RUNNING",
        "gain": "RUNNING",
    }
    assert gain.data.tags["mlflow.parentRunId"] == at_work[""].info.run_id
    stopped.send(signal.SIGINT)
    assert stopped.ended().returncode == 130
    assert {name: run.info.status for name, run in by_method(uri).items()} == {
        "": "KILLED",
        "gain": "KILLED",
    }

    assert Started(tmp_path, *words).ended().returncode == 0
    done = by_method(uri)
    assert {name: run.info.status for name, run in done.items()} == dict.fromkeys(
        ["", "gain", "gain2"], "FINISHED"
    )
    assert {run.data.tags["mlflow.parentRunId"] for name, run in done.items() if name} == {
        done[""].info.run_id
    }
    rows = results.read(out)
    for name in ("gain", "gain2"):
        values = rows[(rows["method"] == name) & (rows["metric"] == "redness")].sort_values(
            "view"
        )["value"]
        assert steps(uri, done[name]) == {
            step: [pytest.approx(value)] for step, value in enumerate(values)
        }
    pictures = [path.name for path in (artifacts(done["gain"]) / "images").glob("*.png")]
    assert len(pictures) == 3


def test_a_trial_of_another_sweeper_is_there_while_it_runs(out: Path, uri: str, tmp_path: Path):
    pytest.importorskip("hydra_plugins.hydra_optuna_sweeper")
    sweep = ("hydra/sweeper=optuna", "hydra.sweeper.n_trials=1", "objective=redness.plain")
    stays = ("method.stays_at=v2.png", f"method.log={tmp_path / 'log'}")
    trial = ("method=gain", "method.gain=interval(1,2)", *stays)
    stopped = Started(tmp_path, "run", "-m", *RUN[1:], *sweep, *trial, f"out={out}")
    waited_for(lambda: any(steps(uri, run) for run in runs(uri) if "method" in run.data.tags))
    stopped.send(signal.SIGINT)
    assert stopped.ended().returncode == 130
    assert [run.info.status for run in runs(uri)] == ["KILLED", "KILLED"]


@pytest.mark.parametrize("launcher", ["workers", "joblib"])
def test_a_job_of_any_launcher_has_its_options_scores_data_and_faults(
    bench, program, out: Path, uri: str, launcher: str
):
    command = bench if launcher == "workers" else program
    if launcher == "joblib":
        pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    words = (
        "run",
        "-m",
        *RUN[1:],
        "method=gain,faulty",
        f"hydra/launcher={launcher}",
        f"out={out}",
    )
    assert command(*words).returncode == 1
    logged, rows = by_method(uri), results.read(out)
    assert set(logged) == {"", "gain", "faulty"}
    parent, gain, faulty = (logged[name] for name in ("", "gain", "faulty"))
    assert [run.info.status for run in (parent, gain, faulty)] == [
        "FAILED",
        "FINISHED",
        "FAILED",
    ]
    assert "boom" in faulty.data.tags["reason"]
    assert (faulty.data.metrics["views_ok"], faulty.data.metrics["views_failed"]) == (2, 1)
    assert steps(uri, faulty).keys() == {0, 2}, "the view that failed leaves its step out"

    params = {"method.gain": "1", "dataset.name": "toy", "degrade.noise": "0"}
    params |= {"replicate": "0", "seed": "0", "degrade.seed": "0"}
    assert gain.data.params.items() >= params.items()
    of_gain = rows[(rows["method"] == "gain") & (rows["metric"] == "redness")]
    assert gain.data.metrics["redness.plain"] == pytest.approx(of_gain["value"].mean())
    (data,) = [one.dataset for one in gain.inputs.dataset_inputs]
    assert (data.name, data.digest) == ("toy", of_gain["data_id"].iloc[0])

    files = artifacts(gain)
    table = json.loads((files / "scores.json").read_text())
    assert table["columns"][:3] == ["step", "scene", "view"]
    assert [row[0] for row in table["data"]] == [0, 1, 2]
    assert {path.name for path in (files / "restored").iterdir()} == {
        f"v{n}.{suffix}" for n in range(3) for suffix in ("png", "json")
    }
    pictures = {
        name: sorted(
            int(re.findall(r"step\D(\d+)", path.name)[0])
            for path in (artifacts(run) / "images").glob("*.png")
        )
        for name, run in logged.items()
        if name
    }
    assert pictures == {"gain": [0, 1, 2], "faulty": [0, 2]}
    assert len(pd.read_parquet(artifacts(parent) / "scores.parquet")) == len(rows)
    assert "gain" in parent.data.tags["mlflow.note.content"]
    # that of the figures
    assert gain.data.tags["mlflow.runColor"] == style.own_look("gain").colour


def test_environment_variables_of_mlflow_are_the_defaults(
    bench, tmp_path: Path, empty: Path, monkeypatch
):
    elsewhere = f"sqlite:///{shutil.copy(empty, tmp_path / 'elsewhere.db')}"
    monkeypatch.setenv("MLFLOW_TRACKING_URI", elsewhere)
    monkeypatch.setenv("MLFLOW_EXPERIMENT_NAME", "dives")
    shutil.copytree(empty.parent, tmp_path / "local")
    for choice, method in (("", "gain"), ("tracking=local", "gain2"), ("tracking=off", "gain")):
        out = choice.partition("=")[2] or "out"
        done = bench(*RUN, f"method={method}", f"out={out}", *([choice] if choice else []))
        assert done.returncode == 0, done.stderr
    assert {run.data.tags.get("method", "") for run in runs(elsewhere, "dives")} == {"", "gain"}
    assert {
        run.data.tags.get("method", "")
        for run in runs(f"sqlite:///{tmp_path}/local/mlflow.db", "dives")
    } == {
        "",
        "gain2",
    }
    assert not list((tmp_path / "off").glob("mlflow*"))
    assert bench("track", "off").returncode == 0
    assert len(runs(elsewhere, "dives")) == 4


def test_a_server_that_is_down_costs_no_view_and_one_line_and_is_made_up_for(
    bench, out: Path, uri: str, monkeypatch
):
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
    done = bench(*RUN, "method=gain", f"out={out}", "tracking.uri=http://127.0.0.1:9")
    assert done.returncode == 0
    assert done.stderr.count("not logged") == 1
    assert len(pd.read_parquet(out / "scores.parquet")["view"].unique()) == 3
    assert bench("track", "out").stdout.splitlines()[0].endswith("1 new run")
    assert by_method(uri)["gain"].info.status == "FINISHED"
    assert bench("track", "out").stdout.splitlines()[0].endswith("0 new runs")
    assert "mlflow" not in bench(*RUN, "method=gain", f"out={out}").stderr, "nothing is new"


def test_a_password_in_the_address_is_neither_printed_nor_stored(
    bench, tmp_path: Path, monkeypatch
):
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
    uri = f"http://me:{PASSWORD}@127.0.0.1:9"
    said = [
        bench(*RUN, "method=gain", "out=out", f"tracking.uri={uri}"),
        bench("track", "out", "--uri", uri),
        bench("report", "out"),
    ]
    assert [done.returncode for done in said] == [0, 2, 0]
    assert not [done for done in said if PASSWORD in done.stdout + done.stderr]
    files = [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert len(files) > 5
    assert not [path for path in files if PASSWORD.encode() in path.read_bytes()]


def test_runs_that_start_together_on_a_new_store_are_all_kept(tmp_path: Path):
    uri = f"sqlite:///{tmp_path / 'shared' / 'mlflow.db'}"
    started = [
        Started(tmp_path, *RUN, "method=gain", f"out={n}", f"tracking.uri={uri}")
        for n in range(2)
    ]
    done = [one.ended() for one in started]
    assert [d.returncode for d in done] == [0] * 2, [d.stderr for d in done]
    assert not any("not logged" in d.stderr for d in done)
    logged = runs(uri)
    assert len(logged) == 4  # a parent and a child each
    assert {r.info.status for r in logged} == {"FINISHED"}


# -- later -------------------------------------------------------------------------------------------------


def test_a_folder_is_logged_once_and_what_is_new_in_it_goes_on_in_its_runs(
    bench, out: Path, uri: str
):
    """As after a run on a cluster, where nothing was logged."""
    said = []
    for more in (("method=gain", "views=[v1.png]"), (), ("method=gain2",), ("method=gain",)):
        if more:
            bench(*RUN, *more, "tracking=off", "out=out")
        said.append(bench("track", "out").stdout.splitlines()[0])
    assert [line.split(": ")[-1].strip() for line in said] == [
        "1 new run",
        "0 new runs",
        "1 new run",
        "1 new run",
    ]
    logged = by_method(uri)
    views = {name: run.data.metrics["views_ok"] for name, run in logged.items()}
    assert views == {"": 6, "gain": 3, "gain2": 3}
    values = results.read(out, method="gain", metric="redness").set_index("view")["value"]
    assert steps(uri, logged["gain"]) == {
        k: [pytest.approx(values[f"v{n}.png"])] for k, n in enumerate((1, 0, 2))
    }


def test_another_version_of_a_methods_code_is_another_run(out: Path, uri: str):
    for second, code in enumerate(("a" * 12, "b" * 12)):
        own = row("m", "a.png", 1.0, code=code, time=f"2026-01-01T00:00:0{second}", **SECONDS)
        results.write_rows(out, "m", [own])
        assert log(out, Place(uri, "sucre_bench")) == 1
    codes = [run.data.tags["code"] for run in runs(uri) if "method" in run.data.tags]
    assert sorted(codes) == ["a" * 12, "b" * 12]


def test_means_are_those_of_the_table(out: Path, uri: str):
    """Views count alike there, however many charts each has: 10 in one view, 30 in another."""
    angles = {"a.png": (10.0,), "b.png": (20.0, 30.0, 40.0)}
    kind = {"metric": "psi", "variant": "colour", "unit": "deg", "better": "lower"}
    psi = [
        row("gray_world", view, value, region=f"chart{number}", **kind)
        for view, values in angles.items()
        for number, value in enumerate(values)
    ]
    seconds = [row("gray_world", view, 1.0, **SECONDS) for view in angles]
    results.write_rows(out, "made", [*seconds, *psi])
    (table,) = compare.compare(results.read(out))
    assert log(out, Place(uri, "sucre_bench")) == 1
    (column,) = [c for c in table.columns if c.metric == "psi"]
    assert (
        by_method(uri)["gray_world"].data.metrics["psi.colour"]
        == table.cells["gray_world", column].mean
        == 20
    )


@pytest.mark.parametrize("fault", [ConnectionError("gone"), KeyboardInterrupt()])
def test_what_is_broken_off_goes_on(
    bench, out: Path, uri: str, monkeypatch: pytest.MonkeyPatch, fault: BaseException
):
    bench("run", "-m", *RUN[1:], "method=gain,gain2", f"out={out}", "tracking=off")
    picture = out / "restored/toy/gain/v1.png"
    picture.write_bytes(picture.read_bytes()[:-20])  # costs no more than itself
    store = type(asked(uri))
    log_artifacts, logged = store.log_artifacts, []

    def breaks(*arguments: Any) -> None:
        logged.append(arguments)
        if len(logged) == 2:
            raise fault
        log_artifacts(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(store, "log_artifacts", breaks)
        with pytest.raises((OutputError, KeyboardInterrupt)):
            log(out, Place(uri, "sucre_bench"))
    if isinstance(fault, KeyboardInterrupt):
        assert "RUNNING" not in {run.info.status for run in by_method(uri).values()}
    assert log(out, Place(uri, "sucre_bench")) == 1
    assert {name: run.info.status for name, run in by_method(uri).items()} == dict.fromkeys(
        ["", "gain", "gain2"], "FINISHED"
    )


@pytest.mark.parametrize("content", [b"no database", None])
def test_a_store_that_cannot_be_used_is_named_with_the_reason(
    bench, tmp_path: Path, content: bytes | None
):
    bench(*RUN, "method=gain", "out=out", "tracking=off")
    store = tmp_path / "store.db"
    store.mkdir() if content is None else store.write_bytes(content)
    with pytest.raises(OutputError, match=r"store\.db: .*mlflow"):
        log(tmp_path / "out", Place(f"sqlite:///{store}", "sucre_bench"))


def test_the_parent_counts_the_views_of_every_dataset(bench, out: Path, uri: str) -> None:
    for noise in (0, 0.05):
        bench(*RUN, "method=gain", f"degrade.noise={noise}", "tracking=off", "out=out")
    bench("track", "out")
    (parent,) = (run for run in runs(uri) if "method" not in run.data.tags)
    assert parent.data.metrics["views_ok"] == 6
