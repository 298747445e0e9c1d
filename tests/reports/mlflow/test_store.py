"""Stores of mlflow: made once a machine, asked only if there is something new, and refused in one line."""

import json
import socket
from pathlib import Path
from typing import Any

import pytest

from sucre_bench import compare, results
from sucre_bench.errors import InputError
from sucre_bench.reports import mlflow

PASSWORD = "pa55word"


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache of the user's."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture(scope="module")
def place_of_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def used_cache(place_of_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cache of the user's that keeps what these tests put into it: an empty store takes seconds to make."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(place_of_cache))


@pytest.fixture
def out(bench, toys: str, tmp_path: Path) -> Path:
    words = ("dataset=toy", "method=gain", "metrics=[redness]", "report=false", "tracking.uri=off", "out=out")
    bench("run", "--plugin", toys, *words)
    return tmp_path / "out"


def asked(uri: str) -> Any:
    """What asks a store. mlflow is imported here: the search for tests would take a second longer in each process."""
    from mlflow import MlflowClient

    return MlflowClient(tracking_uri=uri)


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


def test_a_table_that_is_logged_is_known_without_asking_mlflow(used_cache: None, out: Path):
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


def test_mlflows_first_screen_has_the_columns_that_decide_and_its_pictures_are_no_links(used_cache: None, out: Path):
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
def test_a_store_that_cannot_be_used_is_named_with_the_reason(used_cache: None, out: Path, content: bytes | None):
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


def test_a_password_in_the_address_is_neither_printed_nor_stored(bench, toys: str, tmp_path: Path, monkeypatch):
    monkeypatch.setenv("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "0")
    uri = f"http://me:{PASSWORD}@127.0.0.1:9"
    words = ["dataset=toy", "method=gain", "metrics=[redness]", "out=out"]
    said = [
        bench("run", "--plugin", toys, *words, f"tracking.uri={uri}"),
        bench("track", "out", "--uri", uri),
        bench("report", "out"),
    ]
    assert [done.returncode for done in said] == [0, 2, 0]
    assert not [done for done in said if PASSWORD in done.stdout + done.stderr]
    files = [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert len(files) > 5
    assert not [path for path in files if PASSWORD.encode() in path.read_bytes()]
