"""Where mlflow keeps its runs: a client, the experiment, and mlflow's own page."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from sucre_bench.errors import InputError
from sucre_bench.results.rows import fingerprint

if TYPE_CHECKING:
    from mlflow import MlflowClient

__all__ = ["connect", "default_uri", "open_ui", "runs_page"]

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
    from filelock import FileLock

    uri, artifacts = _resolved(uri), None
    lock = Path(tempfile.gettempdir()) / f"sucre_bench-{fingerprint({'uri': uri})[1]}.lock"
    if uri.startswith(_SQLITE):
        if awkward := set(uri) & set("?%#"):
            raise InputError(
                f"{uri}: mlflow cannot keep a store under a path with {' '.join(awkward)}; give another URI"
            )
        store = Path(uri.removeprefix(_SQLITE))
        store.parent.mkdir(parents=True, exist_ok=True)
        lock, artifacts = store.with_name(f".{store.name}.lock"), (store.parent / "mlartifacts").as_uri()
    with FileLock(lock):
        client = _client(uri)
        there = client.get_experiment_by_name(experiment)
        return client, there.experiment_id if there else client.create_experiment(experiment, artifacts, _ABOUT)


def _resolved(uri: str) -> str:
    path = uri.removeprefix(_SQLITE)
    return uri if not uri.startswith(_SQLITE) or path.startswith("/") else f"{_SQLITE}{Path(path).resolve()}"


def _client(uri: str) -> MlflowClient:
    os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "1")
    os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "10")
    import logging

    logging.getLogger("alembic").setLevel(logging.WARNING)  # it tells of every migration of a new store
    logging.getLogger("mlflow.store.db.utils").setLevel(logging.WARNING)
    from mlflow import MlflowClient

    return MlflowClient(tracking_uri=uri)


def runs_page(uri: str, experiment: str, port: int) -> str:
    """Return the address of an experiment's runs on the page that `open_ui` serves."""
    return f"http://127.0.0.1:{port}/#/experiments/{connect(uri, experiment)[1]}/runs"


def open_ui(uri: str, port: int) -> int:
    """Serve mlflow's page on this machine alone until it is stopped, and return its exit status."""
    from sucre_bench.machine.sigterm import terminated_as_interrupt

    serving = [sys.executable, "-m", "mlflow", "ui", "--backend-store-uri", _resolved(uri), "--host", "127.0.0.1"]
    quiet = {
        "MLFLOW_DISABLE_TELEMETRY": "true",
        "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false",
        "PYTHONWARNINGS": "ignore",
    }
    log = ["--uvicorn-opts", "--log-level warning"]
    with subprocess.Popen([*serving, "--port", str(port), *log], env={**os.environ, **quiet}) as server:
        try:
            with terminated_as_interrupt():
                return server.wait()
        finally:  # a kill of ours alone would leave it running
            server.terminate()
