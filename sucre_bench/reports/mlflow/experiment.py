"""The runs that an experiment of mlflow has of one results folder."""

from __future__ import annotations

import hashlib
import os
import shutil
import socket
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

from sucre_bench import results
from sucre_bench.arrays import DataFrame

if TYPE_CHECKING:
    from mlflow import MlflowClient


@dataclass(frozen=True)
class Experiment:
    """An experiment of mlflow, and the results folder that is logged in it."""

    client: MlflowClient
    experiment: str
    out: Path

    def has(self, rows: DataFrame) -> bool:
        """Whether a run of these very rows has been ended."""
        ended = "attributes.status != 'RUNNING' and attributes.status != 'KILLED'"
        query = f"tags.rows = '{rows_hash(rows)}' and {ended}"
        return bool(self.client.search_runs([self.experiment], query, max_results=1))

    def end_abandoned(self) -> None:
        """Mark runs of this folder as killed whose process, on this machine, was killed."""
        import psutil

        for run in self.client.search_runs([self.experiment], "attributes.status = 'RUNNING'"):
            machine, _, process = run.data.tags.get("process", "").rpartition(" ")
            is_of_here = run.data.tags.get("out") == str(self.out.resolve()) and machine == socket.gethostname()
            if is_of_here and not psutil.pid_exists(int(process)):
                self.client.set_terminated(run.info.run_id, "KILLED")

    def latest(self) -> dict[tuple[str, str], list[str]]:
        """The newest runs of this folder by dataset and method, both empty for its parent run."""
        found: dict[tuple[str, str], list[str]] = {}
        token: str | None = None
        while token != "":
            page = self.client.search_runs([self.experiment], "tags.latest = 'yes'", page_token=token)
            for run in page:
                if run.data.tags.get("out") == str(self.out.resolve()):
                    key = (run.data.tags.get("dataset", ""), run.data.tags.get("method", ""))
                    found.setdefault(key, []).append(run.info.run_id)
            token = page.token or ""
        return found

    def succeed(self, run: str, older: Iterable[str]) -> None:
        """Mark a run as the newest of its dataset and method, and older runs as not."""
        self.client.set_tag(run, "latest", "yes")
        for other in older:
            self.client.set_tag(other, "latest", "no")

    @contextmanager
    def run(self, name: str, rows: DataFrame, tags: Mapping[str, str]) -> Iterator[str]:
        """A run from the time its rows begin to that of their end; one that is broken off does not go on for ever."""
        about = {"mlflow.source.name": "sucre-bench", "mlflow.source.type": "LOCAL", "mlflow.user": _user()}
        process = f"{socket.gethostname()} {os.getpid()}"
        all_tags = {**about, "out": str(self.out.resolve()), "process": process, **tags}
        run = str(self.client.create_run(self.experiment, stamp(rows["time"].min()), all_tags, name).info.run_id)
        try:
            yield run
        except BaseException:
            with suppress(Exception):  # of what broke it off; mlflow may be gone
                self.client.set_terminated(run, "KILLED")
            raise
        failed = (rows["status"] == "failed").any()
        self.client.set_terminated(run, "FAILED" if failed else "FINISHED", stamp(rows["time"].max()))

    def log_table(self, run: str, rows: DataFrame) -> None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / results.TABLE
            rows.to_parquet(path, index=False)
            self.client.log_artifact(run, str(path))

    def log_folder(self, run: str, folder: Path, name: str) -> None:
        """Make a folder an artifact of a run. A store on the same disk gets hard links: no second copy.

        No file of a results folder is changed in place: the artifact stays as it was if a view is restored again.
        """
        place = local_path(self.client.get_run(run).info.artifact_uri)
        if place is None:
            self.client.log_artifacts(run, str(folder), name)
        else:
            shutil.copytree(folder, place / name, copy_function=_linked, dirs_exist_ok=True)


def local_path(uri: str) -> Path | None:
    """Return the folder of a file URI on this machine; None for any other URI."""
    parts = urlsplit(uri)
    return Path(unquote(parts.path)) if parts.scheme == "file" and not parts.netloc else None


def _linked(source: str, target: str) -> None:
    """Make a hard link; a copy on another disk, of another user's file, or of what a symbolic link leads to."""
    if not Path(source).is_symlink():
        with suppress(OSError):
            Path(target).hardlink_to(source)
            return
    shutil.copyfile(source, target)


def _user() -> str:
    import getpass

    try:
        return getpass.getuser()
    except (OSError, KeyError):  # in a container, an id without a name
        return "unknown"


def stamp(time: str) -> int:
    """Return a row's time as mlflow has it: milliseconds since 1970."""
    import pandas as pd

    return int(pd.Timestamp(str(time)).timestamp() * 1000)


def rows_hash(rows: DataFrame) -> str:
    """Return what identifies rows in any order: 16 hex digits."""
    import pandas as pd

    ordered = rows.sort_values([*rows.columns[:4], "metric", "variant", "region"], kind="stable")
    return hashlib.blake2b(
        pd.util.hash_pandas_object(ordered, index=False).to_numpy().tobytes(), digest_size=8
    ).hexdigest()
