"""Serves mlflow's own page on this machine, and opens it on a table of methods with the columns that decide."""

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from sucre_bench.compare import Column, Comparison
from sucre_bench.compare.answer import deciding
from sucre_bench.errors import InputError
from sucre_bench.machine.files import temporary_folder
from sucre_bench.reports.mlflow.store import connect, resolved, said_of

# mlflow's page reads what it shows first from this tag of the experiment, if its address names the key.
_KEY = "sucre_bench"
VIEW_TAG = f"mlflow.sharedViewState.{_KEY}"
_HOST = "127.0.0.1"


def view_of(comparisons: Sequence[Comparison]) -> str:
    """Return the tag's value: the newest run of each method and the columns that decide, best first.

    It is what mlflow's own button "share" writes, as JSON.
    """
    chosen = [deciding(comparison) for comparison in comparisons]
    columns = dict.fromkeys(column for one in chosen for column in one.columns)
    main = next((one.main for one in chosen if one.main), None)
    keys = [_key(column) for column in columns]
    state: dict[str, Any] = {
        "selectedColumns": keys,
        "columnOrder": ["attributes.`Run Name`", *keys],
        "searchFilter": "tags.latest = 'yes' and tags.method LIKE '%'",
    }
    if main is not None:
        state |= {"orderByKey": _key(main), "orderByAsc": main.better == "lower"}
    return json.dumps(state)


def _key(column: Column) -> str:
    return f"metrics.`{column.metric}.{column.variant}`"


def runs_page(uri: str, experiment: str, port: int) -> str:
    """Return the address of an experiment's runs: on the page that `open_ui` serves, or on the server of the URI."""
    place = uri.rstrip("/") if uri.startswith(("http://", "https://")) else f"http://{_HOST}:{port}"
    with said_of(uri):
        runs = f"{place}/#/experiments/{connect(uri, experiment)[1]}/runs"
    return f"{runs}?viewStateShareKey={_KEY}&workflowType=machine_learning"


def check_port(port: int) -> None:
    """Raise InputError if a port of this machine cannot be served."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as servers do: of one that has just ended
        try:
            probe.bind((_HOST, port))
        except OSError as fault:
            raise InputError(f"--port {port}: {fault.strerror}; give another, for example --port {port + 1}") from None


def open_ui(uri: str, port: int, ready: Callable[[], None]) -> int:
    """Serve mlflow's page on this machine alone until it is stopped, and return its exit status.

    ready: called when the page can be opened.
    """
    from sucre_bench.machine.processes import terminated_as_interrupt

    store = resolved(uri) if ":" in uri else str(Path(uri).resolve())  # seen from here, not from the server's folder
    settings = {
        "MLFLOW_BACKEND_STORE_URI": store,  # not as arguments, which all users of the machine can read
        "MLFLOW_REGISTRY_STORE_URI": store,
        "MLFLOW_DISABLE_TELEMETRY": "true",
        "MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false",
        "PYTHONWARNINGS": "ignore",
    }
    words = [sys.executable, "-m", "mlflow", "ui", "--host", _HOST, "--port", str(port)]
    words += ["--uvicorn-opts", "--log-level warning"]
    with (
        temporary_folder() as empty,  # mlflow's server puts the current folder first where it looks for modules
        subprocess.Popen(words, cwd=empty, env={**os.environ, **settings}, stdout=subprocess.DEVNULL) as server,
    ):
        try:
            with terminated_as_interrupt():
                while server.poll() is None and not _answers(port):
                    time.sleep(0.2)
                if server.poll() is None:
                    ready()
                return server.wait()
        finally:  # a kill of ours alone would leave it running
            server.terminate()


def _answers(port: int) -> bool:
    with suppress(OSError), socket.create_connection((_HOST, port), timeout=5):
        return True
    return False
