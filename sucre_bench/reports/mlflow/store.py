"""The store of mlflow's runs: made quickly, checked before mlflow opens it, asked only if there is something new.

And mlflow's own page, served on this machine and opened on a table of methods with the columns that decide.
"""

from __future__ import annotations

import hashlib
import logging
import os
import socket
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING

from sucre_bench.errors import InputError, OutputError, SucreBenchError, in_words
from sucre_bench.machine.cache import get_or_make, waited_lock
from sucre_bench.machine.files import regular, temporary_folder, user_cache, write_atomically
from sucre_bench.machine.processes import terminated_as_interrupt
from sucre_bench.machine.provenance import version_of
from sucre_bench.machine.text_formats import masked
from sucre_bench.results import TABLE
from sucre_bench.results.rows import fingerprint

if TYPE_CHECKING:
    from mlflow import MlflowClient

# mlflow's page reads what it shows first from this tag of the experiment, if its address names the key.
_VIEW_KEY = "sucre_bench"
VIEW_TAG = f"mlflow.sharedViewState.{_VIEW_KEY}"

_HOST = "127.0.0.1"

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
    """The store in an output folder."""
    return f"{_SQLITE}{out}/mlflow.db"


def resolved(uri: str) -> str:
    """Return a URI with the path of a sqlite store in full."""
    path = sqlite_path(uri)
    return uri if path is None else f"{_SQLITE}{path}"


def sqlite_path(uri: str) -> Path | None:
    """Return the file of a sqlite store, from where we are; None for any other URI."""
    return Path(uri.removeprefix(_SQLITE)).absolute() if uri.startswith(_SQLITE) else None


def connect(uri: str, experiment: str) -> tuple[MlflowClient, str]:
    """Return a client and the experiment's id; store and experiment are made where missing.

    By one process at a time: several that open a new sqlite store at once break it. Raises InputError for a store that
    mlflow cannot use: it would try for minutes, sqlite says at once why it cannot.
    """
    path, artifacts = sqlite_path(uri), None
    uri = resolved(uri)
    lock = Path(tempfile.gettempdir()) / f"sucre_bench-{fingerprint({'uri': uri})[1]}.lock"
    if path is not None:
        if awkward := set(uri) & set("?%#"):
            fault = f"mlflow cannot keep a store under a path with {' '.join(awkward)}"
            raise InputError(fault, uri, "give another URI")
        path.parent.mkdir(parents=True, exist_ok=True)
        lock, artifacts = path.with_name(f".{path.name}.lock"), (path.parent / "mlartifacts").as_uri()
    with waited_lock(lock, _PATIENCE_S):
        if path is not None:
            if not path.exists() or not path.stat().st_size:
                with suppress(OSError, sqlite3.Error):  # else mlflow makes its own
                    kept = user_cache() / f"mlflow-{version_of('mlflow')}.db"
                    stored = get_or_make(kept, lambda kept: kept.read_bytes() if kept.is_file() else None, _make_store)
                    write_atomically(path, stored)
            try:
                with closing(sqlite3.connect(path, timeout=_SQLITE_PATIENCE_S, isolation_level=None)) as opened:
                    opened.execute("BEGIN IMMEDIATE")
                    opened.execute("ROLLBACK")
            except sqlite3.Error as fault:
                remedy = "move it away, or give another URI"
                raise InputError(f"mlflow cannot use this store, {fault}", path, remedy) from None
        client = _client(uri)
        there = client.get_experiment_by_name(experiment)
        return client, there.experiment_id if there else client.create_experiment(experiment, artifacts, _ABOUT)


@contextmanager
def one_line_for(uri: str) -> Iterator[None]:
    """Raise what mlflow raises in this block as OutputError: one line, without passwords."""
    try:
        yield
    except SucreBenchError:
        raise
    except Exception as fault:
        reason = shorten(masked(in_words(fault)), 200)
        raise OutputError(f"cannot log in mlflow, {reason}", masked(uri), "check the URI") from fault


def _client(uri: str) -> MlflowClient:
    """A client without telemetry, with few retries, and without lines of its own."""
    settings = {"DISABLE_TELEMETRY": "true", "HTTP_REQUEST_MAX_RETRIES": "1", "HTTP_REQUEST_TIMEOUT": "10"}
    for name, value in settings.items():
        os.environ.setdefault(f"MLFLOW_{name}", value)
    logging.getLogger("alembic").setLevel(logging.WARNING)  # it tells of every migration of a new store
    logging.getLogger("mlflow.store.db.utils").setLevel(logging.ERROR)
    from mlflow import MlflowClient
    from mlflow.store.db import utils

    utils.MAX_RETRY_COUNT = 2  # of a database that does not answer; the default tries for two minutes
    return MlflowClient(tracking_uri=uri)


def _make_store(path: Path) -> bytes:
    """An empty store. mlflow makes one by more than fifty migrations, which takes seconds: once on a machine."""
    # Without the experiment whose artifacts would lie where it was made: mlflow makes its own in any store without.
    _client(f"{_SQLITE}{path}").search_experiments()
    with closing(sqlite3.connect(path)) as opened:
        opened.execute("DELETE FROM experiments")
        opened.commit()
    return path.read_bytes()


# -- what is logged already -------------------------------------------------------------------------------------------


def is_logged(out: Path, uri: str, experiment: str) -> bool:
    """Whether the score table of `out`, as it is now, was logged there. mlflow is not asked."""
    store = sqlite_path(uri)
    with suppress(OSError, InputError, ValueError):
        note, digest = _note(out, uri, experiment)
        return (store is None or store.is_file()) and regular(note).read_text(encoding="ascii") == digest
    return False


def remember(out: Path, uri: str, experiment: str) -> None:
    """Note that the score table of `out` is logged there."""
    with suppress(OSError, OutputError):  # else mlflow is asked again
        note, digest = _note(out, uri, experiment)
        write_atomically(note, digest.encode())


def _note(out: Path, uri: str, experiment: str) -> tuple[Path, str]:
    """The file that notes what is logged in a store and an experiment, and the digest of the table as it is now."""
    place = fingerprint({"uri": uri, "experiment": experiment})[1]  # shows no password
    with (out / TABLE).open("rb") as table:
        return out / "logs" / f"mlflow-{place}.txt", hashlib.file_digest(table, "blake2b").hexdigest()


# -- mlflow's page ----------------------------------------------------------------------------------------------------


def runs_page(uri: str, experiment: str, port: int) -> str:
    """Return the address of an experiment's runs: on the page that `open_ui` serves, or on the server of the URI."""
    place = uri.rstrip("/") if uri.startswith(("http://", "https://")) else f"http://{_HOST}:{port}"
    with one_line_for(uri):
        runs = f"{place}/#/experiments/{connect(uri, experiment)[1]}/runs"
    return f"{runs}?viewStateShareKey={_VIEW_KEY}&workflowType=machine_learning"


def check_port(port: int) -> None:
    """Raise InputError if a port of this machine cannot be served."""
    try:
        socket.create_server((_HOST, port)).close()
    except OSError as fault:
        raise InputError(f"--port {port}: {fault.strerror}; give another, for example --port {port + 1}") from None


def open_ui(uri: str, port: int, ready: Callable[[], None]) -> int:
    """Serve mlflow's page on this machine alone until it is stopped, and return its exit status.

    ready: called when the page can be opened.
    """
    store = resolved(uri) if ":" in uri else str(Path(uri).resolve())  # seen from here, not from the server's folder
    settings = {
        "MLFLOW_BACKEND_STORE_URI": store,  # not as arguments, which all users of the machine can read
        "MLFLOW_REGISTRY_STORE_URI": store,
        "MLFLOW_DISABLE_TELEMETRY": "true",
        "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false",
        "PYTHONWARNINGS": "ignore",
    }
    words = [sys.executable, "-m", "mlflow", "ui", "--host", _HOST, "--port", str(port)]
    words += ["--workers", "1", "--uvicorn-opts", "--log-level warning"]  # each of the usual 4 imports mlflow: 3 s
    with (
        temporary_folder() as empty,  # mlflow's server puts the current folder first where it looks for modules
        subprocess.Popen(words, cwd=empty, env={**os.environ, **settings}, stdout=subprocess.DEVNULL) as server,
    ):
        try:
            with terminated_as_interrupt():
                while server.poll() is None:
                    with suppress(OSError), socket.create_connection((_HOST, port), timeout=5):
                        break
                    time.sleep(0.2)
                if server.poll() is None:
                    ready()
                return server.wait()
        finally:  # a kill of ours alone would leave it running
            server.terminate()
