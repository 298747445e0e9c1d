"""The records of restored images: what the method said of each, the water for example.

restored/<dataset>/<method label>/records.jsonl has a line of JSON for each restored image, with the sizes of the files
that the job wrote. Processes append lines under a lock. The last line of a picture counts. A line that a killed process
left unfinished is passed over, so its view is restored again.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Any

from sucre_bench.errors import InputError
from sucre_bench.machine.cache import waited_lock
from sucre_bench.machine.files import is_file, read_json, regular, write_atomically, writing

RECORDS = "records.jsonl"
_PICTURE = (
    "picture"  # the name in a record of the restored image, seen from the folder of the records
)

# The newest lines of each file that was read, by picture; with the state that the file had then.
_read: dict[Path, tuple[tuple[int, ...], Mapping[str, bytes]]] = {}


def add_record(folder: Path, picture: Path, record: Mapping[str, Any]) -> None:
    """Append the record of a restored image below the folder. Raises OutputError if it cannot be written."""
    name = picture.relative_to(folder).as_posix()
    line = json.dumps({_PICTURE: name, **record}, allow_nan=False).encode() + b"\n"
    path = folder / RECORDS
    with writing(path), _locked(folder), path.open("a+b") as file:
        if file.tell():
            file.seek(-1, os.SEEK_END)
            # a killed process has left half a line
            line = line if file.read(1) == b"\n" else b"\n" + line
        file.write(line)


def shorten_records(folder: Path) -> None:
    """Write the records anew if more lines are out of date than count. Raises OutputError if that fails."""
    path = folder / RECORDS
    if not path.is_file():
        return
    with writing(path), _locked(folder):
        newest = list(dict(_lines(path)).values())
        if path.stat().st_size > 2 * sum(map(len, newest)) + len(newest):
            write_atomically(path, b"\n".join([*newest, b""]))


def record_of(file: Path) -> dict[str, Any]:
    """Return the record of a restored image, or of a file beside it that differs in its suffix; empty if none is there.

    Other programs may write it as a .json beside the picture. Raises InputError if that file is damaged.
    """
    if record := stored_record(file):
        return record
    content = read_json(file.with_suffix(".json"), "delete it and run again")
    return content if isinstance(content, dict) else {}


def stored_record(file: Path) -> dict[str, Any]:
    """Return what `record_of` does, but only from the records of a job: never from a .json beside the picture."""
    path = records_above(file)
    if path is None or not file.name:
        return {}
    with suppress(OSError, InputError):
        name = file.relative_to(path.parent).with_suffix(".png").as_posix()
        if line := _newest(path).get(name):
            return {key: value for key, value in json.loads(line).items() if key != _PICTURE}
    return {}


def records_above(path: Path) -> Path | None:
    """Return the nearest records in the folders above a file or folder; None without, or if the folder has its own."""
    nearest = next(
        (folder for folder in (path, *path.parents) if is_file(folder / RECORDS)), path
    )
    return None if nearest == path else nearest / RECORDS


def _locked(folder: Path) -> AbstractContextManager[None]:
    """One lock for all jobs of a results folder. folder: restored/<dataset>/<method label> in it."""
    return waited_lock(folder.parents[2] / f".{RECORDS}.lock")


def _newest(path: Path) -> Mapping[str, bytes]:
    """The newest line of each picture; the file is read again only if it has changed."""
    found = path.stat()
    state = (found.st_ino, found.st_mtime_ns, found.st_size)
    read, newest = _read.get(path, (None, {}))
    if read != state:
        newest = dict(_lines(path))
        _read[path] = state, newest
    return newest


def _lines(path: Path) -> Iterator[tuple[str, bytes]]:
    """The name of the picture and the text of each whole line."""
    for line in regular(path).read_bytes().split(b"\n"):
        with suppress(ValueError, TypeError, KeyError, RecursionError):
            yield str(json.loads(line)[_PICTURE]), line
