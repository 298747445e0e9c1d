"""The score table: one row a score, stored as parquet. Tables, figures and the page are made from it.

A job writes its rows to part files of its own, ``parts/<job>-<n>.parquet``, atomically and without a lock. `merge`
joins the parts into ``scores.parquet``. Readers see table and parts together, so a killed run loses nothing that was
written.

Of two rows for one score the one with the later `time` counts.

The table also has scores on common pixels, which `read_both` returns, too, and `read` leaves out.
"""

from __future__ import annotations

import contextlib
import io
import json
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from sucre_bench.arrays import DataFrame, Series
from sucre_bench.errors import (
    ANY_FAULT,
    DamagedFileError,
    ForbiddenFileError,
    MissingFileError,
    OutputError,
    file_error,
    in_words,
)
from sucre_bench.machine.cache import waited_lock
from sucre_bench.machine.files import regular, write_atomically, writing
from sucre_bench.results.rows import (
    COLUMNS,
    KEYS,
    NUMBERS,
    RESTORATION,
    Row,
    Status,
    as_arrow,
    code_parts,
    frame,
    is_of_common_pixels,
)

if TYPE_CHECKING:
    import pyarrow

TABLE = "scores.parquet"
PARTS = "parts"
_SCORE = [*KEYS, "metric", "variant"]
FLUSH_S = 1.0
_JOINED = 64  # files at a time
_ATTEMPTS = 5  # at reading or writing parts while another process merges them

# -- reading -----------------------------------------------------------------------------------------------


def read(out: str | Path, **labels: str) -> DataFrame:
    """Return every row under `out`, table and parts, the newest of each score, each on its method's own pixels.

    labels: a column and its text, for example method= or metric=, for these rows alone, which is quicker.
    Ordered by dataset, method, scene and view, whichever job was first; a view's scores as its metrics were run.
    Raises MissingFileError if there are none, DamagedFileError if a file is damaged, ForbiddenFileError if this user
    may not read one.
    """
    return read_both(out, **labels)[0]


def read_both(out: str | Path, **labels: str) -> tuple[DataFrame, DataFrame]:
    """Return what `read` does, and the rows about common pixels, see `results.common_scores`. Raises as `read`."""
    files, rows = _files(Path(out), labels)
    if not files:
        raise MissingFileError(
            f"no {TABLE} here", out, "give the folder that `sucre-bench run out=...` wrote"
        )
    return _newest(rows)


def read_part(path: Path) -> DataFrame:
    """Return the rows of one part as `read` does; none if another part has them by now."""
    table = _rows_of_file(path, {})
    rows = frame([]) if table is None else table.to_pandas(use_threads=False)
    return rows[~is_of_common_pixels(rows)]


def is_bundle(path: Path) -> bool:
    """Whether a path is to be read as a bundle (`results.bundle_format`), not as a results folder."""
    return path.suffix.lower() == ".zip" and not path.is_dir()


def _files(out: Path, labels: Mapping[str, str]) -> tuple[list[Path], DataFrame]:
    """The files of rows, parts first, and all their rows."""
    import pyarrow

    found: dict[Path, pyarrow.Table] = {}
    for _ in range(_ATTEMPTS):
        try:
            if not out.is_dir():
                break
            paths = sorted(
                path for path in (out / PARTS).iterdir() if path.suffix == ".parquet"
            )
        except (FileNotFoundError, NotADirectoryError):
            paths = []
        except OSError as fault:  # rows must not be left out without a word
            raise file_error(out / PARTS, fault, "let this user read it") from fault
        paths.append(out / TABLE)  # last: a merge writes the table before it removes the parts
        found = {
            path: rows for path in paths if (rows := _rows_of_file(path, labels)) is not None
        }
        if all(path in found for path in paths[:-1]):
            # else a merge or a job has joined a part just now
            break
    if not found:
        return [], frame([])
    # Not threaded: where no thread can start, pyarrow waits for ever.
    return [*found], pyarrow.concat_tables(found.values()).to_pandas(use_threads=False)


def _rows_of_file(path: Path, labels: Mapping[str, str]) -> pyarrow.Table | None:
    """The rows of a file, checked; None if it is not there. Other columns are ignored. labels: as for `read`."""
    import pyarrow
    from pyarrow import compute
    from pyarrow.parquet import ParquetFile

    column = "the file"
    try:
        content = regular(path).read_bytes()  # whole: the file may be replaced while it is read
        held = ParquetFile(io.BytesIO(content), page_checksum_verification=True).read(
            use_threads=False
        )
        held.validate(full=True)  # text that is no text, and numbers that point to none
        read = {}
        for name in COLUMNS:
            column = f"column '{name}'"
            if name not in held.column_names:
                raise ValueError("is missing")
            read[name] = held[name].cast(NUMBERS.get(name, "large_string"))
    except FileNotFoundError:
        return None
    except PermissionError as fault:
        raise file_error(path, fault, "let this user read it") from fault
    except (ForbiddenFileError, ImportError):
        raise
    except ANY_FAULT as fault:  # unpacking damaged bytes raises errors of many kinds, pyarrow's OSError among them
        raise _damaged(path, f"{column}: {in_words(fault)}") from fault
    rows = pyarrow.table(read)
    check_values(path, rows)
    for name, label in labels.items():
        rows = rows.filter(compute.equal(rows[name], label))
    return rows


# NaN, which some writers store as null
_MAY_BE_ABSENT = (
    "value",
    "coverage",
    "seconds",
    "peak_mb",
)


def check_values(path: Path, rows: pyarrow.Table) -> None:
    """Raise DamagedFileError, with the column, for a value that no row can have."""
    import pyarrow
    from pyarrow import compute

    right = {
        name: compute.is_valid(rows[name]) for name in COLUMNS if name not in _MAY_BE_ABSENT
    }
    allowed = {
        "options": [text for text in rows["options"].unique().to_pylist() if _is_object(text)],
        "status": get_args(Status),
        "better": ("higher", "lower", "none"),
    }
    for name, words in allowed.items():
        right[name] = compute.is_in(rows[name], pyarrow.array(words, rows[name].type))
    right |= {
        "time": compute.match_substring_regex(rows["time"], r"^\d{4}-\d\d-\d\d"),
        "n_pixels": compute.greater_equal(rows["n_pixels"], 0),
    }
    for name, are_right in right.items():
        wrong = rows[name].filter(compute.invert(are_right.fill_null(False)))
        if len(wrong):
            raise _damaged(path, f"column '{name}' holds {str(wrong[0].as_py())[:80]!r}")


def _is_object(text: str | None) -> bool:
    try:
        told = json.loads(text or "")
        # raises where "\\udce9" stands for what is no UTF-8
        json.dumps(told, ensure_ascii=False).encode()
        return isinstance(told, dict)
    except (ValueError, RecursionError):
        return False


def _damaged(path: Path, fault: str) -> DamagedFileError:
    return DamagedFileError(
        f"not a table of scores, {fault}", path, "restore a copy, or delete it and run again"
    )


def _newest(rows: DataFrame) -> tuple[DataFrame, DataFrame]:
    """Return the newest of each score on own pixels, and of each score on common pixels."""
    is_common = is_of_common_pixels(rows)
    common = rows[is_common].sort_values("time", kind="stable")
    common = common.drop_duplicates(_SCORE, keep="last", ignore_index=True)
    return _newest_own(rows[~is_common]), common


def _newest_own(rows: DataFrame) -> DataFrame:
    """Keep the newest of each score, and of each restoration only what belongs to its newest try.

    Scores of other options, data or code are not mixed, and a try that failed leaves no older scores standing.
    """
    import pandas as pd

    # numbers are compared faster than texts
    when = pd.Series(pd.factorize(rows["time"], sort=True)[0], rows.index)
    order = when.argsort(kind="stable")
    rows, when = rows.iloc[order], when.iloc[order]
    tried = (
        rows.assign(code=code_parts(rows["code"])["restoration"])
        .groupby(["options_id", "data_id", "code"], sort=False)
        .ngroup()
    )
    restoration = rows.groupby(list(KEYS), sort=False).ngroup()
    is_newest_try = tried == tried.groupby(restoration).transform("last")
    has_ended = is_newest_try & (rows["metric"] == RESTORATION) & (rows["status"] != "ok")
    since = when.where(has_ended, -1).groupby(restoration).transform("max")
    # A row of a whole job that failed stands until the job has done anything since.
    of_job = when.groupby([rows["dataset"], rows["method"]], sort=False).transform("max")
    rows = rows[is_newest_try & (when >= since) & ((rows["view"] != "") | (when == of_job))]
    rows = rows[rows["time"] == rows.groupby(_SCORE, sort=False)["time"].transform("last")]
    rows = rows.drop_duplicates([*_SCORE, "region"]).sort_index()
    return rows.sort_values(
        ["dataset", "method", "scene", "view"], kind="stable", ignore_index=True
    )


def is_fresh(rows: DataFrame) -> Series:
    """Return which rows come from the newest data of their scene."""
    import pandas as pd

    data = rows[["dataset", "scene", "data_id"]].drop_duplicates()
    if not data.duplicated(
        ["dataset", "scene"]
    ).any():  # as in most folders: no scene has older data too
        return pd.Series(True, rows.index)
    newest = rows.groupby(["dataset", "scene", "data_id"])["time"].transform("max")
    return newest == newest.groupby([rows["dataset"], rows["scene"]]).transform("max")


# -- writing -----------------------------------------------------------------------------------------------


class Part:
    """The rows of one job, written as they come.

    Each flush writes the rows since the last one into a file. The file after 64 others takes their rows, too.

    job: a word that tells people whose rows these are; flush_s: most seconds between two writes, while rows come.
    """

    def __init__(self, out: Path, job: str, flush_s: float = FLUSH_S) -> None:
        # no other run's, whatever its process id
        self._stem = out / PARTS / f"{job}-{uuid.uuid4().hex}"
        self._flush_s = flush_s
        self._written = time.monotonic()
        self._n_flushes = 0
        self._pending: list[Row] = []
        self._files: dict[Path, pyarrow.Table] = {}

    def add(self, rows: Sequence[Row]) -> None:
        """Store rows. Raises OutputError if they cannot be written."""
        self._pending.extend(rows)
        if time.monotonic() - self._written >= self._flush_s:
            self.flush()

    def flush(self) -> None:
        """Write the rows since the last flush to the disk."""
        import pyarrow

        self._written = time.monotonic()
        if not self._pending:
            return
        joined = self._files if len(self._files) == _JOINED else {}
        rows = pyarrow.concat_tables([*joined.values(), as_arrow(self._pending)])
        path = self._stem.with_name(f"{self._stem.name}-{self._n_flushes}.parquet")
        for attempt in range(_ATTEMPTS):
            try:
                _write(path, rows)
                break
            except OutputError:  # a merge may have removed the empty folder at that moment
                if attempt == _ATTEMPTS - 1:
                    raise
        for file in joined:
            file.unlink(missing_ok=True)  # a merge may have its rows
        self._files = {} if joined else self._files
        self._files[path] = rows
        self._pending = []
        self._n_flushes += 1


def write_rows(out: Path, job: str, rows: Sequence[Row]) -> None:
    """Write rows that come all at once. Raises OutputError if they cannot be written. job: see `Part`."""
    part = Part(out, job)
    part.add(rows)
    part.flush()


def _write(path: Path, rows: pyarrow.Table) -> None:
    import pyarrow.parquet

    buffer = io.BytesIO()
    pyarrow.parquet.write_table(rows, buffer, write_page_checksum=True)
    write_atomically(path, buffer.getvalue())


def merge(out: Path) -> tuple[DataFrame, DataFrame]:
    """Join the parts into the table, and return what `read_both` returns.

    Safe beside jobs at work, whose files never change, and beside other processes that do the same.
    """
    import pandas as pd
    import pyarrow

    if not out.is_dir():
        return frame([]), frame([])
    with _locked(out):
        files, rows = _files(out, {})
        own, common = _newest(rows)
        parts = [path for path in files if path != out / TABLE]
        if parts:
            every = pd.concat([own, common]) if len(common) else own
            _write(out / TABLE, pyarrow.Table.from_pandas(every, preserve_index=False))
            for part in parts:
                part.unlink(missing_ok=True)
            with suppress(OSError):  # a job has written a new part
                (out / PARTS).rmdir()
        return own, common


@contextlib.contextmanager
def _locked(out: Path) -> Iterator[None]:
    """Keep other processes from changing the table of a results folder at the same time."""
    with contextlib.ExitStack() as held:
        with writing(out):
            out.mkdir(parents=True, exist_ok=True)
            held.enter_context(waited_lock(out / f".{TABLE}.lock"))
        yield
