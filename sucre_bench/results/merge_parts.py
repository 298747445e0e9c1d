"""Joins the parts that jobs write into the score table, while other processes and machines may do the same."""

import contextlib
import io
import uuid
from collections.abc import Iterator
from pathlib import Path

from sucre_bench.arrays import DataFrame
from sucre_bench.machine.files import not_writable
from sucre_bench.machine.locks import waited_lock
from sucre_bench.results.rows import frame
from sucre_bench.results.table import PARTS, TABLE, read_any, write_part

_TAKEN = "taken-"


def merge(out: Path) -> DataFrame:
    """Join the parts into the table, and return it. Safe beside jobs at work and other processes that do the same.

    A part is renamed before it is read: what its job writes from then on is in new parts. The lock spares work. Without
    it, on a file system that has none, no row is lost: no file is removed before another one holds its rows. If the
    file system has no hard links either, two processes that replace the table at the same moment may lose rows.
    """
    if not out.is_dir():
        return frame([])
    with locked(out, TABLE):
        while taken := [mine for part in (out / PARTS).glob("*.parquet") if (mine := _take(part))]:
            before = _identity(out / TABLE)
            rows = read_any(out)
            if _replace_table(rows, out, before):
                for part in taken:
                    part.unlink(missing_ok=True)
                with contextlib.suppress(OSError):  # a job has written a new part
                    (out / PARTS).rmdir()
                return rows
        return read_any(out)


def _take(part: Path) -> Path | None:
    """Rename a part, unless a merge that was killed has; None if another merge has it."""
    if part.name.startswith(_TAKEN):
        return part
    with contextlib.suppress(FileNotFoundError):
        return part.rename(_new_taken(part.parent))
    return None


def _new_taken(parts: Path) -> Path:
    return parts / f"{_TAKEN}{uuid.uuid4().hex}.parquet"


def _identity(table: Path) -> tuple[int, int, int] | None:
    """What tells a table from the one that another process writes into its place; None if there is none."""
    try:
        state = table.stat()
    except FileNotFoundError:
        return None
    return state.st_ino, state.st_mtime_ns, state.st_size


def _replace_table(rows: DataFrame, out: Path, before: tuple[int, int, int] | None) -> bool:
    """Put rows into the place of the table that was read; False if another process has written a table since.

    before: the identity of the table that was read. The rows, and the other table, are parts then.
    """
    table, new, old = out / TABLE, _new_taken(out / PARTS), _new_taken(out / PARTS)
    buffer = io.BytesIO()
    rows.to_parquet(buffer, index=False)
    write_part(new, buffer.getvalue())
    with contextlib.suppress(FileNotFoundError):
        table.rename(old)
    is_same = _identity(old) == before
    try:
        _link(new, table)
    except (FileExistsError, FileNotFoundError):  # another merge was quicker, or has joined the new part already
        return False
    if is_same:
        new.unlink(missing_ok=True)
        old.unlink(missing_ok=True)
    return is_same


@contextlib.contextmanager
def locked(out: Path, table: str) -> Iterator[None]:
    """Keep other processes from changing a table of a results folder at the same time."""
    lock = waited_lock(out / f".{table}.lock")
    with contextlib.ExitStack() as held:
        try:
            out.mkdir(parents=True, exist_ok=True)
            held.enter_context(lock)
        except OSError as fault:
            raise not_writable(out, fault) from fault
        yield


def _link(new: Path, table: Path) -> None:
    """Give a file the table's name, if no other file has it."""
    try:
        table.hardlink_to(new)
    except (FileExistsError, FileNotFoundError):
        raise
    except OSError:  # no links on this file system
        if table.exists():
            raise FileExistsError(table) from None
        new.replace(table)
