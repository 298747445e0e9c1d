"""The score table: one row a score, stored as parquet. Tables, figures and the page are made from it.

A job writes its rows to part files of its own, ``parts/<job>-<n>.parquet``, atomically and without a lock. `merge`
joins the parts into ``scores.parquet``. Readers see table and parts together, so a killed run loses nothing that was
written.

Of two rows for one score the one with the later `time` counts. Reading moves this process's clock beyond the newest row
(`machine.records.now`), so a computer whose clock was set back still writes rows that count.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from sucre_bench.arrays import DataFrame, Series
from sucre_bench.errors import (
    ANY_FAULT,
    DamagedFileError,
    MissingFileError,
    NotAFileError,
    OutputError,
    SucreBenchError,
    file_error,
    in_one_line,
    one_line,
)
from sucre_bench.machine.cache import waited_lock
from sucre_bench.machine.files import not_writable, regular, write_atomically
from sucre_bench.machine.records import not_before
from sucre_bench.results.rows import COLUMNS, KEYS, NUMBERS, RESTORATION, Row, Status, as_arrow, frame

if TYPE_CHECKING:
    import pyarrow

TABLE = "scores.parquet"
PARTS = "parts"
FLUSH_S = 1.0
_JOINED = 8  # files at a time
_SCARCE_BYTES = 100_000_000  # on a disk with less room, rows are written at once
_ATTEMPTS = 5  # at reading or writing parts while another process merges them
_TAKEN = "taken-"  # begins the name of a part that a merge reads

# -- reading -----------------------------------------------------------------------------------------------


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
    return _read_any(out, labels)


def _read_any(out: Path, labels: Mapping[str, str]) -> DataFrame:
    """The rows as `read` returns them; an empty table if there are none."""
    import pyarrow

    rows = frame([])
    if tables := _files_of(out, labels):
        # Not threaded: where no thread can start, pyarrow waits for ever.
        rows = pyarrow.concat_tables(tables).to_pandas(use_threads=False).astype(rows.dtypes.to_dict())
    if len(rows):
        not_before(rows["time"].max())
    return _newest(rows)


def _files_of(out: Path, labels: Mapping[str, str]) -> list[pyarrow.Table]:
    """Table and parts; read again if one is gone by then: a merge is at work, and its rows are elsewhere."""
    for _ in range(_ATTEMPTS):
        paths = _parts(out)
        parts = [_file(path, labels) for path in paths]
        whole = _file(out / TABLE, labels)  # last: what a merge took from the parts by now is in it
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


def _file(path: Path, labels: Mapping[str, str]) -> pyarrow.Table | None:
    """The rows of a file, checked; None if it is no longer there."""
    from pyarrow import compute

    try:
        rows = _decoded(path, regular(path).read_bytes())  # whole: the file may be replaced while it is read
    except FileNotFoundError:
        return None  # merged by another process just now, or never written
    except NotAFileError as no_file:
        raise _damaged(path, no_file.fault) from no_file
    except (SucreBenchError, ImportError):
        raise
    except PermissionError as fault:
        raise file_error(path, fault, "let this user read it") from fault
    except ANY_FAULT as fault:  # unpacking damaged bytes raises errors of many kinds, pyarrow's OSError among them
        raise _damaged(path, one_line(fault)) from fault
    for name, label in labels.items():
        rows = rows.filter(compute.equal(rows[name], label))
    return rows


_TEXT = re.compile(r"(large_)?string(_view)?|dictionary<values=(large_)?string,.*")
_NUMBER = re.compile(r"u?int\d+|(half)?float|double")


def _decoded(path: Path, content: bytes) -> pyarrow.Table:
    """The rows in the content of a file, with the columns of a `Row`. Other columns are ignored."""
    import pyarrow
    from pyarrow.parquet import ParquetFile

    schema = ParquetFile(io.BytesIO(content)).schema_arrow
    if absent := [name for name in COLUMNS if name not in schema.names]:
        raise _damaged(path, f"it lacks {', '.join(absent)}")
    for name in COLUMNS:
        if schema.names.count(name) > 1:
            raise _damaged(path, f"it has two columns '{name}'")
        found = in_one_line(schema.field(name).type)
        if not (_NUMBER if name in NUMBERS else _TEXT).fullmatch(found):
            raise _damaged(path, f"its column '{name}' holds {found}")
    texts = [name for name in COLUMNS if name not in NUMBERS]  # most are the same in thousands of rows
    held = ParquetFile(io.BytesIO(content), read_dictionary=texts).read(list(COLUMNS), use_threads=False)
    held.validate(full=True)  # text that is no text, and numbers that point to none
    columns = []
    for name in COLUMNS:
        try:
            columns.append(held[name].cast(NUMBERS.get(name, "large_string")))
        except pyarrow.ArrowInvalid as fault:
            raise _damaged(path, f"its column '{name}' holds {held[name].type}") from fault
    rows = pyarrow.Table.from_arrays(columns, names=list(COLUMNS))
    check_values(path, rows)
    return rows


_MAY_BE_ABSENT = ("value", "coverage", "seconds", "peak_mb")  # NaN, which some writers store as null
_WORDS: Mapping[str, tuple[str, ...]] = {"status": get_args(Status), "better": ("higher", "lower", "none")}


def check_values(path: Path, rows: pyarrow.Table) -> None:
    """Raise DamagedFileError, with the column, for a value that no row can have."""
    from pyarrow import compute

    for name in COLUMNS:
        if name not in _MAY_BE_ABSENT and rows[name].null_count:
            raise _damaged(path, f"column '{name}' is empty in {rows[name].null_count} rows")
    for name, words in _WORDS.items():
        if not set(rows[name].unique().to_pylist()) <= {*words}:
            raise _damaged(path, f"column '{name}' is none of {', '.join(words)}")
    for text in rows["options"].unique().to_pylist():
        try:
            is_object = isinstance(json.loads(text), dict)
        except (ValueError, RecursionError):
            is_object = False
        if not is_object:
            raise _damaged(path, "column 'options' is no JSON object")
    if len(rows) and not compute.all(compute.match_substring_regex(rows["time"], r"^\d{4}-\d\d-\d\d")).as_py():
        raise _damaged(path, "column 'time' is no time")
    if len(rows) and compute.min(rows["n_pixels"]).as_py() < 0:
        raise _damaged(path, "column 'n_pixels' is negative")


def _damaged(path: Path, fault: str) -> DamagedFileError:
    return DamagedFileError(f"not a table of scores, {fault}", path, "restore a copy, or delete it and run again")


def _newest(rows: DataFrame) -> DataFrame:
    """Keep the newest of each score, and of each restoration only what belongs to its newest try.

    Scores of other options, data or code are not mixed, and a try that failed leaves no older scores standing.
    """
    rows = rows.iloc[_places(rows["time"]).argsort(kind="stable")]
    # Of the code, the part of the restoration alone.
    codes = {text: text.partition(".")[0] for text in rows["code"].unique()}
    tried = rows.assign(code=rows["code"].map(codes)).groupby(["options_id", "data_id", "code"], sort=False).ngroup()
    restoration = rows.groupby(list(KEYS), sort=False).ngroup()
    rows = rows[tried == tried.groupby(restoration).transform("last")]
    when = _places(rows["time"])
    has_ended = (rows["metric"] == RESTORATION) & (rows["status"] != "ok")
    rows = rows[when >= when.where(has_ended, -1).groupby(restoration).transform("max")]
    # A row of a whole job that failed stands until the job has done anything since.
    last = _places(rows["time"]).groupby([rows["dataset"], rows["method"]], sort=False).transform("max")
    rows = rows[(rows["view"] != "") | (_places(rows["time"]) == last)]
    score = rows.groupby([*KEYS, "metric", "variant"], sort=False)["time"]
    rows = rows[rows["time"] == score.transform("last")].drop_duplicates([*KEYS, "metric", "variant", "region"])
    return rows.sort_index().sort_values(["dataset", "method", "scene", "view"], kind="stable", ignore_index=True)


def _places(times: Series) -> Series:
    """The place of each time in the order of all: numbers, which are compared faster than texts."""
    import pandas as pd

    return pd.Series(pd.factorize(times, sort=True)[0], times.index)


def is_fresh(rows: DataFrame) -> Series:
    """Return which rows come from the newest data of their scene."""
    import pandas as pd

    data = rows[["dataset", "scene", "data_id"]].drop_duplicates()
    if not data.duplicated(["dataset", "scene"]).any():  # as in most folders: no scene has older data too
        return pd.Series(True, rows.index)
    newest = rows.groupby(["dataset", "scene", "data_id"])["time"].transform("max")
    return newest == newest.groupby([rows["dataset"], rows["scene"]]).transform("max")


# -- writing -----------------------------------------------------------------------------------------------


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
        self._files: list[Path] = []
        self._written, self._n_flushes, self._n_files = time.monotonic(), 0, 0

    def add(self, rows: Sequence[Row]) -> None:
        """Store rows. Raises OutputError if they cannot be written."""
        self._pending.extend(rows)
        with suppress(OSError):  # no folder yet
            disk = os.statvfs(self._folder.parent)
            if disk.f_bavail * disk.f_frsize < _SCARCE_BYTES:  # when it is full, rows that wait could not be written
                self.flush()
        if time.monotonic() - self._written >= self._flush_s:
            self.flush()

    def flush(self) -> None:
        """Write the rows since the last flush to the disk."""
        self._written = time.monotonic()
        if not self._pending:
            return
        self._write(as_arrow(self._pending))
        self._pending.clear()
        self._n_flushes += 1
        n = self._n_flushes
        while n % _JOINED == 0:
            self._join()
            n //= _JOINED

    def _join(self) -> None:
        """Write the last files as one."""
        import pyarrow.parquet

        paths, tables = self._files[-_JOINED:], []
        del self._files[-_JOINED:]
        for path in paths:
            with suppress(FileNotFoundError):  # a merge has its rows
                tables.append(pyarrow.parquet.read_table(io.BytesIO(path.read_bytes()), use_threads=False))
        if tables:
            self._write(pyarrow.concat_tables(tables))
        for path in paths:
            path.unlink(missing_ok=True)

    def _write(self, rows: pyarrow.Table) -> None:
        self._files.append(self._folder / f"{self._name}-{self._n_files}.parquet")
        self._n_files += 1
        _write_part(self._files[-1], rows)


def write_rows(out: Path, job: str, rows: Sequence[Row]) -> None:
    """Write rows that come all at once. Raises OutputError if they cannot be written. job: see `Part`."""
    part = Part(out, job)
    part.add(rows)
    part.flush()


def _write_part(path: Path, rows: pyarrow.Table) -> None:
    """Write a file of rows among the parts. Raises OutputError if it cannot be written."""
    import pyarrow.parquet

    buffer = io.BytesIO()
    pyarrow.parquet.write_table(rows, buffer)
    for _ in range(_ATTEMPTS - 1):
        with suppress(OutputError):  # a merge may have removed the empty folder at that moment
            return write_atomically(path, buffer.getvalue())
    return write_atomically(path, buffer.getvalue())


# -- joining parts -----------------------------------------------------------------------------------------


def merge(out: Path) -> DataFrame:
    """Join the parts into the table, and return it. Safe beside jobs at work and other processes that do the same.

    A part is renamed before it is read: what its job writes from then on is in new parts. The lock spares work. Where
    two machines do not see each other's locks, no row is lost: no file is removed before another one holds its rows.
    """
    import pyarrow

    table = out / TABLE
    if not out.is_dir():
        return frame([])
    with locked(out, TABLE):
        while taken := _taken(out):
            before = _identity(table)
            rows = _read_any(out, {})
            new, old = _new_taken(out / PARTS), _new_taken(out / PARTS)
            _write_part(new, pyarrow.Table.from_pandas(rows, preserve_index=False))
            with suppress(FileNotFoundError):
                table.rename(old)
            is_old = _identity(old) == before
            if _linked(new, table) and is_old:  # else another machine has written a table: both are parts now
                for part in (*taken, new, old):
                    part.unlink(missing_ok=True)
                with suppress(OSError):  # a job has written a new part
                    (out / PARTS).rmdir()
                return rows
        return _read_any(out, {})


@contextlib.contextmanager
def locked(out: Path, table: str) -> Iterator[None]:
    """Keep other processes from changing a table of a results folder at the same time."""
    with contextlib.ExitStack() as held:
        try:
            out.mkdir(parents=True, exist_ok=True)
            held.enter_context(waited_lock(out / f".{table}.lock"))
        except OSError as fault:
            raise not_writable(out, fault) from fault
        yield


def _taken(out: Path) -> list[Path]:
    """Rename all parts, but those that a merge which was killed has renamed; without those that another merge took."""
    taken = []
    for part in _parts(out):
        with suppress(FileNotFoundError):
            taken.append(part if part.name.startswith(_TAKEN) else part.rename(_new_taken(part.parent)))
    return taken


def _new_taken(parts: Path) -> Path:
    return parts / f"{_TAKEN}{uuid.uuid4().hex}.parquet"


def _identity(table: Path) -> tuple[Any, ...] | None:
    """What tells a table from the one that another process writes into its place; None if there is none."""
    with suppress(FileNotFoundError):
        state = table.stat()
        return state.st_ino, state.st_mtime_ns, state.st_size
    return None


def _linked(new: Path, table: Path) -> bool:
    """Give a file the table's name too; False if another machine was quicker, or has joined the file already."""
    try:
        table.hardlink_to(new)
    except (FileExistsError, FileNotFoundError):
        return False
    except OSError:  # no links on this file system
        new.replace(table)
    return True
