"""mlflow, as a sink: it is told what the table and the output folder already hold, and may fail without harm.

A sweep is a parent run, every (dataset, method) job a child of it. The parent process creates the store before any
job starts, under a lock: several processes that open a new sqlite store at once break it.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from sucre_bench import progress, results
from sucre_bench.config import Sweep
from sucre_bench.errors import InputError
from sucre_bench.job import Job
from sucre_bench.layout import file_name
from sucre_bench.results import fingerprint

if TYPE_CHECKING:
    import pandas as pd
    from mlflow import MlflowClient

__all__ = ["finish_sweep", "log_job", "start_sweep"]

P = ParamSpec("P")
T = TypeVar("T")

_LONGEST_PARAM = 6000


def _harmless(action: Callable[P, T]) -> Callable[P, T | None]:
    """Say in one line what mlflow could not do, and go on."""

    @wraps(action)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> T | None:
        try:
            return action(*args, **kwargs)
        except Exception as fault:
            reason = " ".join(str(fault).split())[:200]
            progress.say(f"mlflow: not logged ({type(fault).__name__}: {reason}); the table has everything")
            return None

    return wrapped


def _client(uri: str) -> MlflowClient:
    os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "1")
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "10")
    import logging

    logging.getLogger("alembic").setLevel(logging.WARNING)  # it tells of every migration of a new store
    logging.getLogger("mlflow.store.db.utils").setLevel(logging.WARNING)
    from mlflow import MlflowClient

    return MlflowClient(tracking_uri=uri)


def _resolved(uri: str) -> str:
    """A sqlite path relative to here, made absolute: a job may run elsewhere."""
    prefix = "sqlite:///"
    path = uri.removeprefix(prefix)
    if not uri.startswith(prefix) or path.startswith("/"):
        return uri
    return f"{prefix}{Path(path).resolve()}"


def _connect(uri: str, experiment: str) -> tuple[MlflowClient, str]:
    """A client and the experiment's id; store and experiment are made where missing, by one process at a time."""
    from filelock import FileLock

    lock, artifacts = Path(tempfile.gettempdir()) / f"sucre_bench-{fingerprint({'uri': uri})[1]}.lock", None
    if uri.startswith("sqlite:///"):
        if awkward := set(uri) & set("?%#"):
            raise InputError(
                f"{uri}: mlflow cannot keep a store under a path with {' '.join(awkward)}; set tracking.uri="
            )
        store = Path(uri.removeprefix("sqlite:///"))
        store.parent.mkdir(parents=True, exist_ok=True)
        lock, artifacts = store.with_name(f".{store.name}.lock"), (store.parent / "mlartifacts").as_uri()
    with FileLock(lock):
        client = _client(uri)
        there = client.get_experiment_by_name(experiment)
        return client, there.experiment_id if there else client.create_experiment(experiment, artifacts)


@_harmless
def start_sweep(sweep: Sweep, name: str) -> str:
    """Create store, experiment and the parent run; return that run's id, empty when tracking is off."""
    job = sweep.jobs[0]
    if job.tracking.uri == "off":
        return ""
    client, experiment = _connect(_resolved(job.tracking.uri), job.tracking.experiment)
    tags = {"mlflow.source.name": "sucre-bench", "out": str(job.out.resolve()), "jobs": str(len(sweep.jobs))}
    run = client.create_run(experiment, run_name=name, tags=tags)
    return str(run.info.run_id)


@_harmless
def log_job(job: Job) -> None:
    """Log one job as a child run: parameters, means and per-view steps, config, table, restored pictures."""
    parent = job.tracking.parent_run
    if job.tracking.uri == "off" or not parent:
        return
    client = _client(_resolved(job.tracking.uri))
    rows = results.read(job.out)
    rows = rows[(rows["dataset"] == job.dataset.label) & (rows["method"] == job.method.label)]
    experiment = client.get_run(parent).info.experiment_id
    tags = {
        "mlflow.parentRunId": parent,
        "dataset": job.dataset.label,
        "method": job.method.label,
        "data_id": ",".join(sorted(set(rows["data_id"]) - {""})),
        "status": _status(rows),
    }
    run = client.create_run(experiment, run_name=f"{job.dataset.label} / {job.method.label}", tags=tags)
    run_id = run.info.run_id
    _log_values(client, run_id, rows, _params(job))
    client.log_text(run_id, job.config, "config.yaml")
    _log_table(client, run_id, rows)
    pictures = job.out / "restored" / file_name(job.dataset.label) / file_name(job.method.label)
    if pictures.is_dir():
        client.log_artifacts(run_id, str(pictures), "restored")
    client.set_terminated(run_id, "FAILED" if (rows["status"] == "failed").any() else "FINISHED")


@_harmless
def finish_sweep(sweep: Sweep, parent: str, rows: pd.DataFrame, finished: bool) -> None:
    """Log the whole table and the environment with the parent run, and end it."""
    job = sweep.jobs[0]
    client = _client(_resolved(job.tracking.uri))
    _log_table(client, parent, rows)
    for name in ("config.yaml", "environment.json"):
        with suppress(FileNotFoundError):
            client.log_artifact(parent, str(job.out / name))
    client.set_terminated(parent, "FINISHED" if finished else "FAILED")


def _status(rows: pd.DataFrame) -> str:
    own = set(rows.loc[rows["metric"] == "seconds", "status"])
    return "failed" if "failed" in own else "skipped" if own == {"skipped"} else "ok"


def _params(job: Job) -> dict[str, Any]:
    chosen = {"method": job.method.record, "dataset": job.dataset.record, "degrade": asdict(job.degrade)}
    return {f"{group}.{name}": value for group, record in chosen.items() for name, value in record.items()}


def _log_values(client: MlflowClient, run_id: str, rows: pd.DataFrame, params: dict[str, Any]) -> None:
    """Parameters, means over units, and every view's value as a step, in as few requests as may be."""
    from mlflow.entities import Metric, Param

    ok = rows[(rows["status"] == "ok") & ~rows["region"].str.contains("/", regex=False)]
    ok = ok[ok["value"].notna() & ~ok["value"].isin([float("inf"), float("-inf")])]
    steps = {name: step for step, name in enumerate(sorted(set(ok["scene"] + "/" + ok["view"])))}
    metrics = []
    for (metric, variant), scores in ok.groupby(["metric", "variant"]):
        key = f"{metric}.{variant}"
        by_view = scores.groupby(["scene", "view"])["value"].mean()
        metrics.append(Metric(key, float(by_view.mean()), _stamp(scores), 0))
        for (scene, view), value in by_view.items():
            metrics.append(Metric(f"views/{key}", float(value), _stamp(scores), steps[f"{scene}/{view}"]))
    listed = [Param(name, _text(value)[:_LONGEST_PARAM]) for name, value in params.items()]
    for start in range(0, len(metrics), 1000):
        client.log_batch(run_id, metrics=metrics[start : start + 1000])
    for start in range(0, len(listed), 100):
        client.log_batch(run_id, params=listed[start : start + 100])


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, default=str)


def _stamp(scores: pd.DataFrame) -> int:
    import pandas as pd

    return int(pd.Timestamp(str(scores["time"].max())).timestamp() * 1000)


def _log_table(client: MlflowClient, run_id: str, rows: pd.DataFrame) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / results.TABLE
        rows.to_parquet(path, index=False)
        client.log_artifact(run_id, str(path))
