"""The score table: one row a score, stored as parquet. Tables, figures and the page are made from it.

A job writes its rows to part files of its own, ``parts/<job>-<n>.parquet``, atomically and without a lock.
`results.merge` joins the parts into ``scores.parquet``. Readers see table and parts together, so a killed run loses
nothing that was written.

Of two rows for one score the one with the later `time` counts. Reading moves this process's clock beyond the newest row
(`machine.clock.now`), so a computer whose clock was set back still writes rows that count.
"""

from __future__ import annotations

import io
import os
import time
import uuid
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from sucre_bench.arrays import DataFrame
from sucre_bench.errors import (
    ANY_FAULT,
    MissingFileError,
    NotAFileError,
    OutputError,
    SucreBenchError,
    file_error,
    one_line,
)
from sucre_bench.machine.clock import not_before
from sucre_bench.machine.files import regular, write_atomically
from sucre_bench.results.damaged_table import check_columns, check_values, damaged
from sucre_bench.results.encoded_rows import TEXTS, as_frame, encoded, joined, of_label, texts_of
from sucre_bench.results.newest_rows import newest
from sucre_bench.results.rows import COLUMNS, Row, as_arrow

if TYPE_CHECKING:
    import pyarrow

TABLE = "scores.parquet"
PARTS = "parts"
FLUSH_S = 1.0
_JOINED = 8  # files at a time
_SCARCE_BYTES = 100_000_000  # on a disk with less room, rows are written at once
_ATTEMPTS = 5  # at reading or writing parts while another process merges them


def read(out: str | Path, **labels: str) -> DataFrame:
    """Return every row under `out`, table and parts, the newest of each score.

    labels: a column and its text, for example method= or metric=, for these rows alone, which is quicker.
    Ordered by dataset, method, scene and view, whichever job was first; a view's scores as its metrics were run.
    Raises MissingFileError if there are none, DamagedFileError if a file is damaged, ForbiddenFileError if this user
    may not read one.
    """
    out = Path(out)
    # In this order: a merge writes the table before it removes the parts.
    if not _parts(out) and not (out / TABLE).exists():
        raise MissingFileError(f"no {TABLE} here", out, "give the folder that `sucre-bench run out=...` wrote")
    return read_any(out, **labels)


def read_any(out: Path, **labels: str) -> DataFrame:
    """Return the rows as `read` does; an empty table if there are none."""
    rows = joined(_tables(out, labels))
    if len(rows):
        not_before(max(texts_of(rows["time"])))
    return as_frame(newest(rows))


def _tables(out: Path, labels: Mapping[str, str]) -> list[pyarrow.Table]:
    """The table and the parts; read again if one is gone by then: a merge is at work, and its rows are elsewhere."""
    for _ in range(_ATTEMPTS):
        paths = _parts(out)
        parts = [_table(path, labels) for path in paths]
        whole = _table(out / TABLE, labels)  # last: what a merge took from the parts by now is in it
        if all(part is not None for part in parts) and (whole is not None or paths == _parts(out)):
            break
    return [table for table in (whole, *parts) if table is not None]


def _parts(out: Path) -> list[Path]:
    """The files of the parts, in order of name. Raises FileError if the system does not list them."""
    try:
        return sorted(path for path in (out / PARTS).iterdir() if path.suffix == ".parquet")
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as fault:  # rows must not be left out without a word
        raise file_error(out / PARTS, fault, "let this user read it") from fault


def _table(path: Path, labels: Mapping[str, str]) -> pyarrow.Table | None:
    """The encoded rows of a file; None if it is no longer there."""
    try:
        content = regular(path).read_bytes()  # whole: the file may be replaced while it is read
    except FileNotFoundError:
        return None  # merged by another process just now, or never written
    except NotAFileError as no_file:
        raise damaged(path, no_file.fault) from no_file
    except OSError as fault:
        raise file_error(path, fault, "let this user read it") from fault
    try:
        rows = _decoded(path, content)
    except (SucreBenchError, ImportError):
        raise
    except ANY_FAULT as fault:  # unpacking damaged bytes raises errors of many kinds, pyarrow's OSError among them
        raise damaged(path, one_line(fault)) from fault
    for name, label in labels.items():
        rows = of_label(rows, name, label)
    return rows


def _decoded(path: Path, content: bytes) -> pyarrow.Table:
    """The encoded rows that the content of a file holds, checked."""
    from pyarrow.parquet import ParquetFile

    check_columns(path, ParquetFile(io.BytesIO(content)))
    file = ParquetFile(io.BytesIO(content), read_dictionary=list(TEXTS))
    held = file.read(list(COLUMNS), use_threads=False)  # where none can start, pyarrow waits for ever
    held.validate(full=True)  # text that is no text, and numbers that point to none
    rows = encoded(held)
    check_values(path, rows)
    return rows


class Part:
    """The rows of one job, written as they come.

    Each flush writes the rows since the last one to a file of its own. Eight files are joined into one, eight of those
    into one again: after n flushes a row was written at most 1 + log8(n) times, and few files lie there.

    job: a word that tells people whose rows these are; flush_s: most seconds between two writes, while rows come.
    """

    def __init__(self, out: Path, job: str, flush_s: float = FLUSH_S) -> None:
        self._folder, self._name = out / PARTS, f"{job}-{uuid.uuid4().hex}"  # no other run's, whatever its process id
        self._flush_s = flush_s
        self._pending: list[Row] = []
        self._files: list[tuple[Path, int]] = []  # and how often each was joined, which falls from file to file
        self._written = time.monotonic()
        self._count = 0

    def add(self, rows: Sequence[Row]) -> None:
        """Store rows. Raises OutputError if they cannot be written."""
        self._pending.extend(rows)
        if time.monotonic() - self._written >= self._flush_s or self._is_room_scarce():
            self.flush()

    def _is_room_scarce(self) -> bool:
        """Whether the disk may be full soon: then rows that wait could no longer be written."""
        try:
            disk = os.statvfs(self._folder.parent)
        except OSError:  # no folder yet
            return False
        return disk.f_bavail * disk.f_frsize < _SCARCE_BYTES

    def flush(self) -> None:
        """Write the rows since the last flush to the disk."""
        self._written = time.monotonic()
        if not self._pending:
            return
        self._write(as_arrow(self._pending), 0)
        self._pending.clear()
        while [level for _, level in self._files[-_JOINED:]] == [self._files[-1][1]] * _JOINED:
            self._join()

    def _join(self) -> None:
        """Write the last files, which are of one level, as one file of the next level."""
        import pyarrow

        paths = [path for path, _ in self._files[-_JOINED:]]
        level = self._files[-1][1] + 1
        del self._files[-_JOINED:]
        tables = [table for path in paths if (table := _arrow_table(path)) is not None]  # else a merge has its rows
        if tables:
            self._write(pyarrow.concat_tables(tables), level)
        for path in paths:
            path.unlink(missing_ok=True)

    def _write(self, table: pyarrow.Table, level: int) -> None:
        path = self._folder / f"{self._name}-{self._count}.parquet"
        self._count += 1
        _write_arrow(table, path)
        self._files.append((path, level))


def write_rows(out: Path, job: str, rows: Sequence[Row]) -> None:
    """Write rows that come all at once. Raises OutputError if they cannot be written. job: see `Part`."""
    part = Part(out, job)
    part.add(rows)
    part.flush()


def _arrow_table(path: Path) -> pyarrow.Table | None:
    """A part as it lies on the disk; None if it is no longer there."""
    import pyarrow.parquet

    try:
        return pyarrow.parquet.read_table(io.BytesIO(path.read_bytes()), use_threads=False)
    except FileNotFoundError:
        return None


def _write_arrow(rows: pyarrow.Table, path: Path) -> None:
    import pyarrow.parquet

    buffer = io.BytesIO()
    pyarrow.parquet.write_table(rows, buffer)
    write_part(path, buffer.getvalue())


def write_part(path: Path, content: bytes) -> None:
    """Write a file of rows among the parts. Raises OutputError if it cannot be written."""
    for _ in range(_ATTEMPTS - 1):
        with suppress(OutputError):  # a merge may have removed the empty folder at that moment
            return write_atomically(path, content)
    return write_atomically(path, content)
