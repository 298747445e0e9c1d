"""The long table: one row a score, kept as parquet. Everything people see is made from it.

A job writes its rows to a part of its own, ``parts/<job>.parquet``, whole and atomically each time, and waits for
nobody; `merge` joins the parts into ``scores.parquet``. Readers see table and parts together, so a killed run loses
nothing that was written.
"""

from __future__ import annotations

import contextlib
import io
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sucre_bench.errors import InputError, OutputError, one_line
from sucre_bench.machine.files import _not_writable, write_atomically
from sucre_bench.results.rows import _RESTORATION, COLUMNS, Row, frame

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Part", "merge", "read"]

TABLE = "scores.parquet"


PARTS = "parts"


_FLUSH_SECONDS = 1.0


_TAKEN = "taken-"


_ATTEMPTS = 5  # to read parts that are merged meanwhile


def read(out: str | Path, **labels: str) -> pd.DataFrame:
    """Return every row under `out`, table and parts, the newest of each score.

    labels: dataset=, method= for the rows of these alone, which is quicker.
    Ordered by dataset, method, scene and view, whichever job was first; a view's scores as its metrics were run.
    Raises InputError when there are none, or a file is damaged.
    """
    out = Path(out)
    if not (out / TABLE).is_file() and not list((out / PARTS).glob("*.parquet")):
        raise InputError(f"{out}: no {TABLE} here; give the folder that `sucre-bench run out=...` wrote")
    return _read(out, **labels)


def _read(out: Path, **labels: str) -> pd.DataFrame:
    import pandas as pd

    tables = _tables(out, labels)
    rows = pd.concat([t for t in tables if len(t)] or [frame([])], ignore_index=True)
    return _newest(rows)


def _tables(out: Path, labels: Mapping[str, str]) -> list[pd.DataFrame]:
    """The table and the parts, read anew where a part goes meanwhile: it may not have been in the table yet."""
    for _ in range(_ATTEMPTS):
        parts = [_table(path, labels) for path in sorted((out / PARTS).glob("*.parquet"))]
        whole = _table(out / TABLE, labels)  # last: what a merge took from the parts by now is in it
        if all(part is not None for part in parts):
            break
    return [table for table in (whole, *parts) if table is not None]


def _table(path: Path, labels: Mapping[str, str]) -> pd.DataFrame | None:
    import pandas as pd
    import pyarrow

    try:
        content = io.BytesIO(path.read_bytes())  # whole: the file may be replaced while it is read
        rows = pd.read_parquet(content, filters=[(name, "==", label) for name, label in labels.items()] or None)
    except FileNotFoundError:
        return None  # merged by another process just now, or never written
    except (pyarrow.ArrowInvalid, OSError) as fault:
        raise InputError(f"{path}: not a table of scores ({one_line(fault)}); delete it and run again") from fault
    if absent := [name for name in COLUMNS if name not in rows]:
        raise InputError(f"{path}: not a table of scores, it lacks {', '.join(absent)}; delete it and run again")
    return rows[list(COLUMNS)]


def _newest(rows: pd.DataFrame) -> pd.DataFrame:
    """Keep the newest of each score, and of each restoration only what belongs to its newest try.

    Scores of other options, data or code are not mixed, and a try that failed leaves no older scores standing.
    """
    if rows.empty:
        return rows
    rows = rows.assign(_code=rows["code"].str.split(".").str[0]).sort_values("time", kind="stable")
    same = ["options_id", "data_id", "_code"]
    rows = rows[(rows[same] == rows.groupby(_RESTORATION)[same].transform("last")).all(axis=1)]
    ended = rows["time"].where((rows["metric"] == "seconds") & (rows["status"] != "ok"), "")
    rows = rows[rows["time"] >= ended.groupby([rows[c] for c in _RESTORATION]).transform("max")]
    job_failed = rows["view"] == ""  # stands until the job has done anything since
    rows = rows[~job_failed | (rows["time"] == rows.groupby(["dataset", "method"])["time"].transform("max"))]
    score = [*_RESTORATION, "metric", "variant"]
    rows = rows[rows["time"] == rows.groupby(score)["time"].transform("max")]
    rows = rows.drop(columns="_code").drop_duplicates([*score, "region"]).sort_index()
    return rows.sort_values(["dataset", "method", "scene", "view"], kind="stable", ignore_index=True)


class Part:
    """The rows of one job, written as they come: at most a second's worth is not yet on the disk.

    job: a word that tells people whose it is.
    """

    def __init__(self, out: Path, job: str) -> None:
        self._path = out / PARTS / f"{job}-{uuid.uuid4().hex}.parquet"  # no other run's, whatever its process id
        self._rows: list[Row] = []
        self._written = time.monotonic()

    def add(self, rows: Sequence[Row]) -> None:
        """Keep rows; OutputError when they cannot be written."""
        self._rows.extend(rows)
        if time.monotonic() - self._written > _FLUSH_SECONDS:
            self.flush()

    def flush(self) -> None:
        """Write everything to the disk now."""
        if self._rows:
            table = frame(self._rows)
            try:
                _write_table(table, self._path)
            except OutputError:  # a merge may have removed the empty folder at that moment
                _write_table(table, self._path)
        self._written = time.monotonic()


def merge(out: Path) -> pd.DataFrame:
    """Join the parts into the table, and return it. Safe beside jobs at work and other processes that do the same.

    A part is taken by another name first: what its job writes from then on is a new part, with every row of the job.
    """
    if not out.is_dir():
        return frame([])
    with _locked(out):
        taken = [_take(part) for part in (out / PARTS).glob("*.parquet")]
        rows = _read(out)
        if taken:
            _write_table(rows, out / TABLE)
            for part in taken:
                part.unlink(missing_ok=True)
            with contextlib.suppress(OSError):  # a job has written a new part
                (out / PARTS).rmdir()
    return rows


def _take(part: Path) -> Path:
    if part.name.startswith(_TAKEN):  # by a merge that was killed
        return part
    return part.rename(part.with_name(f"{_TAKEN}{uuid.uuid4().hex}.parquet"))


@contextlib.contextmanager
def _locked(out: Path) -> Iterator[None]:
    """Keep other processes from joining parts at the same time."""
    from filelock import FileLock

    try:
        out.mkdir(parents=True, exist_ok=True)
        lock = FileLock(out / f".{TABLE}.lock")
        lock.acquire()
    except OSError as fault:
        raise _not_writable(out, fault) from fault
    try:
        yield
    finally:
        lock.release()


def _write_table(rows: pd.DataFrame, path: Path) -> None:
    buffer = io.BytesIO()
    rows.to_parquet(buffer, index=False)
    write_atomically(path, buffer.getvalue())
