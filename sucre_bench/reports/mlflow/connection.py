"""Connects to mlflow: a client, and the experiment."""

from __future__ import annotations

import gc
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING

from sucre_bench.errors import InputError, OutputError, SucreBenchError, one_line
from sucre_bench.machine.cache import waited_lock
from sucre_bench.machine.records import masked
from sucre_bench.reports.mlflow import store
from sucre_bench.results.rows import fingerprint

if TYPE_CHECKING:
    from mlflow import MlflowClient

_PATIENCE_S = 600  # for other processes that open the same store; after 3 s a line says who does

_SQLITE = "sqlite:///"
# An experiment's tags: its kind, by which mlflow's page opens on runs and models, not on chats; and its description.
_ABOUT = {
    "mlflow.experimentKind": "custom_model_development",
    "mlflow.note.content": "Unfold a run, a command of sucre-bench, to see its own: one for each method and dataset. "
    "`psnr.masked` is a mean over views, `views/psnr.masked` has a step a view, and so have the pictures `restored`. "
    "Find runs by ``tags.method = 'NAME'``, ``params.`dataset.OPTION` = 'VALUE'`` or ``metrics.views_failed > 0``.",
}


def default_uri(out: Path) -> str:
    """The store in an output folder."""
    return f"{_SQLITE}{out}/mlflow.db"


def connect(uri: str, experiment: str) -> tuple[MlflowClient, str]:
    """Return a client and the experiment's id; store and experiment are made where missing.

    By one process at a time: several that open a new sqlite store at once break it. A path in a sqlite URI is taken
    from where we are. Raises InputError for a path that mlflow cannot take.
    """
    _keep_quiet()
    uri, artifacts = resolved(uri), None
    lock = Path(tempfile.gettempdir()) / f"sucre_bench-{fingerprint({'uri': uri})[1]}.lock"
    path = sqlite_path(uri)
    if path is not None:
        if awkward := set(uri) & set("?%#"):
            raise InputError(
                f"mlflow cannot keep a store under a path with {' '.join(awkward)}", uri, "give another URI"
            )
        path.parent.mkdir(parents=True, exist_ok=True)
        lock, artifacts = path.with_name(f".{path.name}.lock"), (path.parent / "mlartifacts").as_uri()
    with waited_lock(lock, _PATIENCE_S):
        if path is not None:
            store.make(path)
            store.check(path)
        client = _client(uri)
        there = client.get_experiment_by_name(experiment)
        return client, there.experiment_id if there else client.create_experiment(experiment, artifacts, _ABOUT)


@contextmanager
def said_of(uri: str) -> Iterator[None]:
    """Raise what mlflow raises in this block as OutputError: one line, without passwords."""
    try:
        yield
    except SucreBenchError:
        raise
    except Exception as fault:
        reason = shorten(masked(one_line(fault)), 200)
        raise OutputError(f"cannot log in mlflow, {reason}", masked(uri), "check the URI") from fault


def sqlite_path(uri: str) -> Path | None:
    """Return the file of a sqlite store; None for any other URI."""
    return Path(resolved(uri).removeprefix(_SQLITE)) if uri.startswith(_SQLITE) else None


def resolved(uri: str) -> str:
    """Return a URI with the path of a sqlite store in full."""
    path = uri.removeprefix(_SQLITE)
    return uri if not uri.startswith(_SQLITE) or path.startswith("/") else f"{_SQLITE}{Path(path).resolve()}"


def _keep_quiet() -> None:
    """Settings of mlflow, which it reads when it is imported: no telemetry, few retries, no lines of its own."""
    os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "1")
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "10")
    import logging

    logging.getLogger("alembic").setLevel(logging.WARNING)  # it tells of every migration of a new store
    logging.getLogger("mlflow.store.db.utils").setLevel(logging.ERROR)


def _client(uri: str) -> MlflowClient:
    with _without_collections():
        from mlflow import MlflowClient
        from mlflow.store.db import utils

        utils.MAX_RETRY_COUNT = 2  # of a database that does not answer; the default tries for two minutes
        return MlflowClient(tracking_uri=uri)


@contextmanager
def _without_collections() -> Iterator[None]:
    """Collect no garbage in this block: mlflow imports so much that looking for garbage is a fifth of its start."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
