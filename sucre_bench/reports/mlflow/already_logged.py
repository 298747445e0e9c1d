"""Notes which tables of a results folder were logged where, so that a run with nothing new does not ask mlflow."""

import hashlib
import json
from contextlib import suppress
from pathlib import Path

from sucre_bench.errors import InputError
from sucre_bench.machine.files import regular, write_atomically
from sucre_bench.reports.mlflow.connection import sqlite_path
from sucre_bench.results import TABLE
from sucre_bench.results.rows import fingerprint


def is_logged(out: Path, uri: str, experiment: str) -> bool:
    """Whether the score table of `out`, as it is now, was logged there."""
    store = sqlite_path(uri)
    if store is not None and not store.is_file():
        return False
    return _read(out).get(_place(uri, experiment)) == _digest(out) != ""


def remember(out: Path, uri: str, experiment: str) -> None:
    """Note that the score table of `out` is logged there."""
    known = {**_read(out), _place(uri, experiment): _digest(out)}
    with suppress(OSError):  # else mlflow is asked again
        path = _path(out)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, json.dumps(known, indent=1).encode())


def _path(out: Path) -> Path:
    return out / "logs" / "mlflow.json"


def _place(uri: str, experiment: str) -> str:
    """A name for a store and an experiment that shows no password."""
    return fingerprint({"uri": uri, "experiment": experiment})[1]


def _read(out: Path) -> dict[str, str]:
    try:
        known = json.loads(regular(_path(out)).read_text(encoding="utf-8"))
    except (OSError, InputError, ValueError, RecursionError):
        return {}
    return known if isinstance(known, dict) else {}


def _digest(out: Path) -> str:
    try:
        with (out / TABLE).open("rb") as table:
            return hashlib.file_digest(table, "blake2b").hexdigest()[:32]
    except OSError:
        return ""
