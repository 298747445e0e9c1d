"""Where mlflow keeps runs: its store, opened by one process at a time, and what a results folder notes of it."""

from __future__ import annotations

import json
import logging
import os
import shlex
import tempfile
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any, NamedTuple

from sucre_bench.errors import InputError, OutputError, SucreBenchError, in_words
from sucre_bench.machine.cache import waited_lock
from sucre_bench.machine.files import regular, write_atomically
from sucre_bench.machine.text_formats import masked
from sucre_bench.results.rows import unreplicated

if TYPE_CHECKING:
    from mlflow import MlflowClient

_PATIENCE_S = 600  # for other processes that open the same store
_SQLITE = "sqlite:///"
# An experiment's tags: its kind, by which mlflow's page opens on runs, not on chats; and its description.
_ABOUT = {
    "mlflow.experimentKind": "custom_model_development",
    "mlflow.note.content": "Unfold a run, a results folder, to see its own: one for each method and dataset. "
    "`psnr.masked` is a mean over views, `views/psnr.masked` has a step a view, and so have the pictures `restored`. "
    "Find runs by ``tags.method = 'NAME'``, ``params.`dataset.OPTION` = 'VALUE'`` or ``metrics.views_failed > 0``.",
}


class Place(NamedTuple):
    """A store and an experiment of mlflow."""

    uri: str
    experiment: str

    @classmethod
    def of(cls, out: Path, uri: str, experiment: str) -> Place:
        """Return these; what is empty is as mlflow's own variables say, or a store in the results folder."""
        local = os.environ.get("MLFLOW_TRACKING_URI") or f"{_SQLITE}{out}/mlflow.db"
        usual = os.environ.get("MLFLOW_EXPERIMENT_NAME") or "sucre_bench"
        return cls(uri or local, experiment or usual)

    @property
    def file(self) -> Path | None:
        """The database's file, None for a server."""
        is_file = self.uri.startswith(_SQLITE)
        return Path(self.uri.removeprefix(_SQLITE)).absolute() if is_file else None

    @property
    def how_to_look(self) -> str:
        """The command that shows the runs, or the address of the server that does."""
        is_served = self.uri.startswith("http")
        return masked(
            self.uri if is_served else f"mlflow ui --backend-store-uri {shlex.quote(self.uri)}"
        )


def connect(place: Place) -> tuple[MlflowClient, str]:
    """Return a client and the experiment's id; store and experiment are made where missing.

    By one process at a time: several that open a new sqlite store at once break it. Raises InputError for a path that
    mlflow cannot use.
    """
    file = place.file
    artifacts = None
    lock = Path(tempfile.gettempdir()) / "sucre_bench-mlflow.lock"
    if file is not None:
        if awkward := set(str(file)) & set("?%#"):
            fault = f"mlflow cannot keep a store under a path with {' '.join(awkward)}"
            raise InputError(fault, place.uri, "give another URI")
        file.parent.mkdir(parents=True, exist_ok=True)
        lock = file.with_name(f".{file.name}.lock")
        artifacts = (file.parent / "mlartifacts").as_uri()
    with waited_lock(lock, _PATIENCE_S):
        if file is not None:
            _make_store(file)
        client = _client(place.uri if file is None else f"{_SQLITE}{file}")
        known = client.get_experiment_by_name(place.experiment)
        if known:
            return client, known.experiment_id
        return client, client.create_experiment(place.experiment, artifacts, _ABOUT)


def _make_store(file: Path) -> None:
    """Make a sqlite store if there is none: whole, or not at all."""
    if not file.exists():
        made = file.with_name(f".{file.name}.new")
        made.unlink(missing_ok=True)
        # mlflow makes it by more than fifty migrations
        _client(f"{_SQLITE}{made}").search_experiments()
        made.replace(file)


def _client(uri: str) -> MlflowClient:
    """A client without telemetry, with few retries, and without lines of its own."""
    settings = {
        "DISABLE_TELEMETRY": "true",
        "HTTP_REQUEST_MAX_RETRIES": "1",
        "HTTP_REQUEST_TIMEOUT": "10",
    }
    for name, value in settings.items():
        os.environ.setdefault(f"MLFLOW_{name}", value)
    # alembic logs a line for each migration of a new store
    logging.getLogger("alembic").setLevel(logging.WARNING)
    logging.getLogger("mlflow.store.db.utils").setLevel(logging.ERROR)
    from mlflow import MlflowClient

    if uri.startswith(_SQLITE):
        from mlflow.store.db import utils

        # of a database that does not answer; else it takes two minutes
        utils.MAX_RETRY_COUNT = 2
    return MlflowClient(tracking_uri=uri)


@contextmanager
def reported(uri: str) -> Iterator[None]:
    """Raise what mlflow raises in this block as OutputError: one line, without passwords. mlflow prints nothing."""
    try:
        with Path(os.devnull).open("w") as none, redirect_stdout(none), redirect_stderr(none):
            yield
    except SucreBenchError:
        raise
    except Exception as fault:
        reason = shorten(masked(in_words(fault)), 200)
        if "failed with exception" in reason:
            # of a request, which has the reason in many words
            reason = "the server does not answer"
        raise OutputError(
            f"cannot log in mlflow, {reason}", masked(uri), "check the URI"
        ) from fault


class Note:
    """What a results folder notes of its runs, in `logs/mlflow.json`.

    folder: an id, by which its runs are found again, also where the folder was moved.
    """

    def __init__(self, out: Path) -> None:
        self._path = out / "logs" / "mlflow.json"
        self._content: dict[str, Any] = {"folder": uuid.uuid4().hex, "views": {}}
        with suppress(OSError, InputError, ValueError):
            self._content = json.loads(regular(self._path).read_text(encoding="utf-8"))
        self._write()  # the folder's id, before any run has it
        self.folder: str = self._content["folder"]

    def n_views(self, dataset: str) -> int:
        """Return how many views have a step."""
        return len(self._content["views"].get(dataset, ()))

    def steps(
        self, dataset: str, views: Iterable[tuple[str, str]]
    ) -> dict[tuple[str, str], int]:
        """Return the steps of views, by scene and name, alike for all methods. New views follow known ones."""
        known = self._content["views"].setdefault(dataset, [])
        places = {tuple(name): step for step, name in enumerate(known)}
        names = {view: (unreplicated(view[0])[0], view[1]) for view in sorted(set(views))}
        for name in names.values():
            places.setdefault(name, len(places))
        if len(places) > len(known):
            self._content["views"][dataset] = [*places]
            self._write()
        return {view: places[name] for view, name in names.items()}

    def _write(self) -> None:
        with suppress(OSError, OutputError):  # else the runs are not found again
            write_atomically(self._path, json.dumps(self._content).encode())
