"""What mlflow is told, and its stores: made once a machine, asked only if there is something new."""

import json
import re
import socket
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from support.command_line import Started, registry
from support.places import TOYS

from sucre_bench import compare, plugins, results
from sucre_bench.commands.run_summary import compared, track
from sucre_bench.engine.hydra_run import run_words as run_jobs
from sucre_bench.engine.run import Outcome
from sucre_bench.errors import InputError, OutputError
from sucre_bench.reports import mlflow
from sucre_bench.reports.paper import style
from sucre_bench.results.rows import Row

pytestmark = pytest.mark.usefixtures("toys")
PASSWORD = "pa55word"


def run_and_track(*overrides: str, multirun: bool = False) -> Outcome:
    """Run and log, as the command line does."""
    outcome = run_jobs(overrides, multirun)
    track(outcome, compared(outcome))
    return outcome


def asked(uri: str) -> Any:
    """What asks a store. mlflow is imported here: the search for tests would take a second longer in each process."""
    from mlflow import MlflowClient

    return MlflowClient(tracking_uri=uri)


def runs(uri: str) -> list:
    client = asked(uri)
    experiments = [e.experiment_id for e in client.search_experiments() if e.name == "sucre_bench"]
    return client.search_runs(experiments) if experiments else []


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """A sweep of two methods, of which one fails on a view."""
    out = tmp_path_factory.mktemp("sweep") / "out"
    with plugins.using(registry(TOYS)):
        words = ("dataset=toy", "method=gain,faulty", "metrics=[redness]", f"out={out}")
        return run_and_track(*words, multirun=True)


def test_a_sweep_is_a_parent_run_with_a_child_a_job(sweep: Outcome):
    outcome, out = sweep, sweep.out
    logged = runs(f"sqlite:///{out / 'mlflow.db'}")
    (parent,) = [r for r in logged if "mlflow.parentRunId" not in r.data.tags]
    children = {r.data.tags["method"]: r for r in logged if r is not parent}
    assert set(children) == {"gain", "faulty"}
    assert {r.data.tags["mlflow.parentRunId"] for r in children.values()} == {parent.info.run_id}
    assert (children["gain"].info.status, children["faulty"].info.status) == ("FINISHED", "FAILED")

    gain = children["gain"]
    assert json.loads(gain.data.params["method.gain"]) == 1.0
    assert gain.data.params["dataset.name"] == "toy"
    rows = outcome.rows[(outcome.rows["method"] == "gain") & (outcome.rows["metric"] == "redness")]
    assert gain.data.metrics["redness.plain"] == pytest.approx(rows["value"].mean())
    client = asked(f"sqlite:///{out / 'mlflow.db'}")
    steps = client.get_metric_history(gain.info.run_id, "views/redness.plain")
    by_step = [m.value for m in sorted(steps, key=lambda m: m.step)]
    assert by_step == pytest.approx(rows.sort_values("view")["value"].tolist())

    artifacts = Path(gain.info.artifact_uri.removeprefix("file://"))
    assert {p.name for p in artifacts.iterdir()} == {"scores.parquet", "restored", "images"}
    pictures = {p.name for p in (artifacts / "restored").iterdir()}
    assert pictures == {*(f"v{n}.png" for n in range(3)), "records.jsonl"}
    kept, restored = (folder / "v0.png" for folder in (artifacts / "restored", out / "restored" / "toy" / "gain"))
    assert kept.read_bytes() == restored.read_bytes()
    before = kept.read_bytes()
    again = ["dataset=toy", "method=gain", "method.gain=2", "overwrite=always", "metrics=[redness]", f"out={out}"]
    run_jobs(again, False)
    assert kept.read_bytes() == before != restored.read_bytes()
    whole = Path(parent.info.artifact_uri.removeprefix("file://")) / "scores.parquet"
    assert len(pd.read_parquet(whole)) == len(outcome.rows)


def test_what_people_look_for_is_where_mlflow_shows_it(sweep: Outcome):
    uri = f"sqlite:///{sweep.out / 'mlflow.db'}"
    client = asked(uri)
    (experiment,) = [e for e in client.search_experiments() if e.name == "sucre_bench"]
    assert experiment.tags["mlflow.experimentKind"] == "custom_model_development"  # runs and models, no chats
    assert experiment.tags["mlflow.note.content"]
    logged = {r.info.run_name: r for r in runs(uri)}
    assert set(logged) == {"out", "gain on toy", "faulty on toy"}
    colours = [logged[name].data.tags["mlflow.runColor"] for name in ("gain on toy", "faulty on toy")]
    assert colours == [style.own_look("gain").colour, style.own_look("faulty").colour]  # those of the figures
    faulty = logged["faulty on toy"]
    assert "boom" in faulty.data.tags["mlflow.note.content"]
    assert (faulty.data.metrics["views_ok"], faulty.data.metrics["views_failed"]) == (2, 1)
    found = client.search_runs([experiment.experiment_id], "metrics.views_failed > 0")
    assert [r.info.run_name for r in found] == ["faulty on toy"]


def test_pictures_have_the_step_of_their_view_in_every_run(sweep: Outcome):
    """The view that one method failed on leaves a gap; mlflow shows the others beside the right ones."""
    steps = {}
    for run in runs(f"sqlite:///{sweep.out / 'mlflow.db'}"):
        folder = Path(run.info.artifact_uri.removeprefix("file://")) / "images"
        if folder.is_dir():
            names = [p.name for p in folder.iterdir() if p.suffix == ".png"]
            steps[run.data.tags["method"]] = sorted(int(re.findall(r"step\D(\d+)", name)[0]) for name in names)
    assert steps == {"gain": [0, 1, 2], "faulty": [0, 2]}


def test_the_page_opens_on_the_runs(tmp_path: Path):
    uri = f"sqlite:///{tmp_path / 'mlflow.db'}"
    first, second = (mlflow.runs_page(uri, name, 5001) for name in ("dives", "others"))
    assert first == mlflow.runs_page(uri, "dives", 5001) != second
    assert first.startswith("http://127.0.0.1:5001/#/experiments/")


def test_a_folder_is_told_once_and_what_is_new_in_it_later(bench, tmp_path: Path):
    """As after a run on a cluster, where nothing was logged."""

    words = (
        "run",
        "--plugin",
        str(TOYS),
        "dataset=toy",
        "metrics=[redness]",
        "tracking.uri=off",
        "out=out",
        "report=false",
    )
    said = []
    for more in (("method=gain", "views=[v0.png]"), (), ("method=gain2",), ("method=gain",)):
        if more:
            bench(*words, *more)
        said.append(bench("track", "out").stdout)
    assert [line.split(": ")[-1].strip() for line in said] == ["1 new run", "0 new runs", "1 new run", "1 new run"]
    told = runs(f"sqlite:///{tmp_path / 'out' / 'mlflow.db'}")
    latest = [r for r in told if r.data.tags["latest"] == "yes"]
    views = {r.data.tags.get("method", ""): r.data.metrics.get("views_ok") for r in latest}
    assert views == {"": None, "gain": 3, "gain2": 3}
    assert len(latest) == len(views), "one a method, and their newest parent"
    assert [r.data.metrics["views_ok"] for r in told if r not in latest and "method" in r.data.tags] == [1]


def test_runs_that_start_together_on_a_new_store_are_all_kept(tmp_path: Path):
    uri = f"sqlite:///{tmp_path / 'shared' / 'mlflow.db'}"
    words = ["run", "--plugin", str(TOYS), "dataset=toy", "method=gain", "metrics=[redness]", "report=false"]
    started = [Started(tmp_path, *words, f"out={tmp_path / str(n)}", f"tracking.uri={uri}") for n in range(2)]
    done = [one.ended() for one in started]
    assert [d.returncode for d in done] == [0] * 2, [d.stderr for d in done]
    assert not any("mlflow: not logged" in d.stderr for d in done)
    logged = runs(uri)
    assert len(logged) == 4  # a parent and a child each
    assert {r.info.status for r in logged} == {"FINISHED"}


def test_a_server_that_is_down_costs_no_result(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch):
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
    arguments = ["dataset=toy", "method=gain", "metrics=[redness]", f"out={tmp_path / 'out'}"]
    outcome = run_and_track(*arguments, "tracking.uri=http://127.0.0.1:9")
    assert (outcome.ok, outcome.exit_code) == (3, 0)
    assert capsys.readouterr().err.count("mlflow: not logged") == 1


def test_means_are_those_of_the_table(tmp_path: Path):
    """Views count alike there, however many charts each has: 10 in one view, 30 in another."""
    options = json.dumps({"name": "gray_world", "dataset": {"name": "demo"}})
    base = Row("demo", "reef", method="gray_world", options=options, options_id="o", data_id="d")
    angles = {"a.png": (10.0,), "b.png": (20.0, 30.0, 40.0)}
    kind = {"metric": "psi", "variant": "colour", "unit": "deg", "better": "lower"}
    psi = [
        replace(base, **kind, view=view, region=f"chart{number}", value=value)
        for view, values in angles.items()
        for number, value in enumerate(values)
    ]
    rows = results.frame([*(replace(base, view=view, value=1.0) for view in angles), *psi])
    tables, uri = compare.compare(rows), f"sqlite:///{tmp_path / 'mlflow.db'}"
    assert mlflow.log(tmp_path, rows, tables, uri, "sucre_bench") == 1
    (child,) = [r for r in runs(uri) if "method" in r.data.tags]
    (column,) = [c for c in tables[0].columns if c.metric == "psi"]
    assert child.data.metrics["psi.colour"] == tables[0].cells["gray_world", column].mean == 20


def test_what_is_broken_off_is_told_again_and_leaves_nothing_running(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    out, uri = tmp_path / "out", f"sqlite:///{tmp_path / 'mlflow.db'}"
    run_jobs(["dataset=toy", "method=gain,gain2", "metrics=[redness]", f"out={out}", "tracking.uri=off"], True)
    rows = results.read(out)
    picture = out / "restored/toy/gain/v1.png"
    picture.write_bytes(picture.read_bytes()[:-20])  # costs no more than itself
    store = type(asked(uri))
    set_tag, told = store.set_tag, []

    def breaks(client: Any, run: str, key: str, value: object, *more: object) -> None:
        told.extend([run] if (key, value) == ("latest", "yes") else [])
        if len(told) == 3:  # the parent and a child are marked as the latest
            raise ConnectionError("gone")
        set_tag(client, run, key, value, *more)

    with monkeypatch.context() as patch:
        patch.setattr(store, "set_tag", breaks)
        with pytest.raises(OutputError, match="gone"):
            mlflow.log(out, rows, compare.compare(rows), uri, "sucre_bench")
    assert sorted(r.info.status for r in runs(uri)) == ["FINISHED", "KILLED", "KILLED"]
    assert mlflow.log(out, rows, compare.compare(rows), uri, "sucre_bench") == 1
    latest = {r.data.tags.get("method", ""): r.info.status for r in runs(uri) if r.data.tags.get("latest") == "yes"}
    assert latest == {"": "FINISHED", "gain": "FINISHED", "gain2": "FINISHED"}


# -- stores ------------------------------------------------------------------------------------------------


@pytest.fixture
def cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of the user's that these tests share, empty at first: an empty store takes seconds to make."""
    folder = tmp_path_factory.getbasetemp() / "cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    return folder


@pytest.fixture
def out(bench, tmp_path: Path) -> Path:
    words = ("dataset=toy", "method=gain", "metrics=[redness]", "report=false", "tracking.uri=off", "out=out")
    bench("run", "--plugin", str(TOYS), *words)
    return tmp_path / "out"


def log(out: Path, uri: str = "") -> int:
    rows = results.read(out)
    return mlflow.log(out, rows, compare.compare(rows), uri or mlflow.default_uri(out), "sucre_bench")


def test_later_stores_are_copies_of_the_first_and_keep_nothing_of_where_that_was(cache: Path, tmp_path: Path):
    for name in ("one", "two"):
        mlflow.runs_page(f"sqlite:///{tmp_path / name}.db", "dives", 5000)
        client = asked(f"sqlite:///{tmp_path / name}.db")
        experiments = client.search_experiments()
        assert {e.name for e in experiments} == {"Default", "dives"}
        assert not [e for e in experiments if "sucre_bench-" in e.artifact_location]
        assert len([*(cache / "sucre_bench").glob("*.db")]) == 1


def test_a_table_that_is_logged_is_known_without_asking_mlflow(cache: Path, out: Path):
    uri = mlflow.default_uri(out)
    assert not mlflow.is_logged(out, uri, "sucre_bench")
    log(out)
    assert mlflow.is_logged(out, uri, "sucre_bench")
    assert not mlflow.is_logged(out, uri, "another")
    table = out / "scores.parquet"
    whole = table.read_bytes()
    results.read(out).iloc[:-1].to_parquet(table, index=False)
    assert not mlflow.is_logged(out, uri, "sucre_bench")
    table.write_bytes(whole)
    (out / "mlflow.db").unlink()
    assert not mlflow.is_logged(out, uri, "sucre_bench")


def test_mlflows_first_screen_has_the_columns_that_decide_and_its_pictures_are_no_links(cache: Path, out: Path):
    picture = out / "restored" / "toy" / "gain" / "v0.png"
    content = picture.read_bytes()
    picture.rename(out / "moved.png")
    picture.symlink_to("../../../moved.png")  # as where a user moved pictures to a larger disk
    log(out)
    (kept,) = (out / "mlartifacts").rglob("restored/v0.png")
    assert (kept.is_symlink(), kept.read_bytes()) == (False, content)
    client = asked(mlflow.default_uri(out))
    experiment = client.get_experiment_by_name("sucre_bench")
    key = mlflow.runs_page(mlflow.default_uri(out), "sucre_bench", 5000).partition("viewStateShareKey=")[2]
    state = json.loads(experiment.tags[f"mlflow.sharedViewState.{key.partition('&')[0]}"])
    assert state["selectedColumns"] == ["metrics.`redness.plain`", "metrics.`seconds.wall`"]
    (run,) = client.search_runs([experiment.experiment_id], state["searchFilter"])
    assert {column.split("`")[1] for column in state["selectedColumns"]} <= {*run.data.metrics}


@pytest.mark.parametrize("content", [b"no database", None])
def test_a_store_that_cannot_be_used_is_named_with_the_reason(cache: Path, out: Path, content: bytes | None):
    store = out.parent / "store.db"
    store.mkdir() if content is None else store.write_bytes(content)
    with pytest.raises(InputError, match=r"store\.db: mlflow "):
        log(out, f"sqlite:///{store}")


def test_a_port_that_cannot_be_served_is_a_line_before_anything_is_done(bench, out: Path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        for wrong in (port, "0", "70000"):
            done = bench("track", "out", "--ui", "--port", wrong)
            assert done.returncode == 2
            assert len(done.errors) == 1
            assert wrong in done.stderr
    assert not (out / "mlflow.db").exists()


def test_a_password_in_the_address_is_neither_printed_nor_stored(bench, tmp_path: Path, monkeypatch):
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
    uri = f"http://me:{PASSWORD}@127.0.0.1:9"
    words = ["dataset=toy", "method=gain", "metrics=[redness]", "out=out"]
    said = [
        bench("run", "--plugin", str(TOYS), *words, f"tracking.uri={uri}"),
        bench("track", "out", "--uri", uri),
        bench("report", "out"),
    ]
    assert [done.returncode for done in said] == [0, 2, 0]
    assert not [done for done in said if PASSWORD in done.stdout + done.stderr]
    files = [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert len(files) > 5
    assert not [path for path in files if PASSWORD.encode() in path.read_bytes()]
