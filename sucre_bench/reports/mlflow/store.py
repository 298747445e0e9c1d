"""Where mlflow keeps runs: its store, opened by one process at a time, and what a results folder notes of it."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import shlex
import sqlite3
import tempfile
import uuid
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any

from sucre_bench.errors import InputError, OutputError, SucreBenchError, in_words
from sucre_bench.machine.cache import waited_lock
from sucre_bench.machine.files import regular, write_atomically
from sucre_bench.machine.text_formats import masked
from sucre_bench.results import TABLE
from sucre_bench.results.rows import fingerprint

if TYPE_CHECKING:
    from mlflow import MlflowClient

_PATIENCE_S = 600  # for other processes that open the same store
_SQLITE_PATIENCE_S = 10
_SQLITE = "sqlite:///"
# An experiment's tags: its kind, by which mlflow's page opens on runs, not on chats; and its description.
_ABOUT = {
    "mlflow.experimentKind": "custom_model_development",
    "mlflow.note.content": "Unfold a run, a command of sucre-bench, to see its own: one for each method and dataset. "
    "`psnr.masked` is a mean over views, `views/psnr.masked` has a step a view, and so have the pictures `restored`. "
    "Find runs by ``tags.method = 'NAME'``, ``params.`dataset.OPTION` = 'VALUE'`` or ``metrics.views_failed > 0``.",
}


def default_uri(out: Path) -> str:
    """Return the store that mlflow's own variable names, or the one in a results folder."""
    return os.environ.get("MLFLOW_TRACKING_URI") or f"{_SQLITE}{out}/mlflow.db"


def default_experiment() -> str:
    """Return the experiment that mlflow's own variable names, or ours."""
    return os.environ.get("MLFLOW_EXPERIMENT_NAME") or "sucre_bench"


def how_to_look(uri: str) -> str:
    """Return the command that shows the runs, or the address of the server that does."""
    return masked(
        uri if uri.startswith("http") else f"mlflow ui --backend-store-uri {shlex.quote(uri)}"
    )


def connect(uri: str, experiment: str) -> tuple[MlflowClient, str]:
    """Return a client and the experiment's id; store and experiment are made where missing.

    By one process at a time: several that open a new sqlite store at once break it. Raises InputError for a store that
    mlflow cannot use: it would try for minutes, sqlite says at once why it cannot.
    """
    path = Path(uri.removeprefix(_SQLITE)).absolute() if uri.startswith(_SQLITE) else None
    artifacts = None
    lock = Path(tempfile.gettempdir()) / f"sucre_bench-{fingerprint({'uri': uri})[1]}.lock"
    if path is not None:
        if awkward := set(str(path)) & set("?%#"):
            fault = f"mlflow cannot keep a store under a path with {' '.join(awkward)}"
            raise InputError(fault, uri, "give another URI")
        path.parent.mkdir(parents=True, exist_ok=True)
        uri = f"{_SQLITE}{path}"
        lock = path.with_name(f".{path.name}.lock")
        artifacts = (path.parent / "mlartifacts").as_uri()
    with waited_lock(lock, _PATIENCE_S):
        if path is not None:
            _check(path)
        client = _client(uri)
        there = client.get_experiment_by_name(experiment)
        return client, there.experiment_id if there else client.create_experiment(
            experiment, artifacts, _ABOUT
        )


def _check(path: Path) -> None:
    """Make a sqlite store if there is none: whole, or not at all. InputError for a file that is no database."""
    if not path.exists() or not path.stat().st_size:
        made = path.with_name(f".{path.name}.new")
        made.unlink(missing_ok=True)
        _client(
            f"{_SQLITE}{made}"
        ).search_experiments()  # mlflow makes it by more than fifty migrations
        made.replace(path)
    try:
        with closing(
            sqlite3.connect(path, timeout=_SQLITE_PATIENCE_S, isolation_level=None)
        ) as opened:
            opened.execute("BEGIN IMMEDIATE")
            opened.execute("ROLLBACK")
    except sqlite3.Error as fault:
        remedy = "move it away, or give another URI"
        raise InputError(f"mlflow cannot use this store, {fault}", path, remedy) from None


def _client(uri: str) -> MlflowClient:
    """A client without telemetry, with few retries, and without lines of its own."""
    settings = {
        "DISABLE_TELEMETRY": "true",
        "HTTP_REQUEST_MAX_RETRIES": "1",
        "HTTP_REQUEST_TIMEOUT": "10",
    }
    for name, value in settings.items():
        os.environ.setdefault(f"MLFLOW_{name}", value)
    # it tells of every migration of a new store
    logging.getLogger("alembic").setLevel(logging.WARNING)
    logging.getLogger("mlflow.store.db.utils").setLevel(logging.ERROR)
    from mlflow import MlflowClient
    from mlflow.store.db import utils

    utils.MAX_RETRY_COUNT = (
        2  # of a database that does not answer; the default tries for two minutes
    )
    return MlflowClient(tracking_uri=uri)


@contextmanager
def one_line_for(uri: str) -> Iterator[None]:
    """Raise what mlflow raises in this block as OutputError: one line, without passwords."""
    try:
        yield
    except SucreBenchError:
        raise
    except Exception as fault:
        reason = shorten(masked(in_words(fault)), 200)
        raise OutputError(
            f"cannot log in mlflow, {reason}", masked(uri), "check the URI"
        ) from fault


class Note:
    """What a results folder notes of its runs, in `logs/mlflow.json`.

    folder: an id, by which its runs are found again, also where the folder was moved; views: scene and view of each
    step, by dataset; logged: the digest of the score table, by store and experiment.
    """

    def __init__(self, out: Path) -> None:
        self._out = out
        self._path = out / "logs" / "mlflow.json"
        content: dict[str, Any] = {}
        with suppress(OSError, InputError, ValueError):
            content = json.loads(regular(self._path).read_text(encoding="utf-8"))
        self.folder: str = content.get("folder", uuid.uuid4().hex)
        self.views: dict[str, list[list[str]]] = content.get("views", {})
        self.logged: dict[str, str] = content.get("logged", {})

    def is_logged(self, uri: str, experiment: str) -> bool:
        """Whether the score table, as it is now, was logged there. mlflow is not asked."""
        path = Path(uri.removeprefix(_SQLITE))
        digest = self.logged.get(_place(uri, experiment))
        return digest == self._digest() and (path.is_file() or not uri.startswith(_SQLITE))

    def remember(self, uri: str, experiment: str) -> None:
        """Note that the score table is logged there."""
        self.logged[_place(uri, experiment)] = self._digest()
        self.write()

    def write(self) -> None:
        """Write it, if the folder can be written."""
        content = {"folder": self.folder, "views": self.views, "logged": self.logged}
        with suppress(OSError, OutputError):  # else mlflow is asked again
            write_atomically(self._path, json.dumps(content).encode())

    def _digest(self) -> str:
        with suppress(OSError), (self._out / TABLE).open("rb") as table:
            return hashlib.file_digest(table, "blake2b").hexdigest()
        return ""


def _place(uri: str, experiment: str) -> str:
    """A store and an experiment as a hash, which shows no password."""
    return fingerprint({"uri": uri, "experiment": experiment})[1]
