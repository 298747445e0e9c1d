"""Checks whether the files of a stored restoration are unchanged.

The record (.json) beside a picture has size, time and hash of the picture, and of the .npz where there is one. A file
of the same size and time is taken for the same; only one of another time, a copy say, is read and hashed.
"""

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from sucre_bench.errors import InputError
from sucre_bench.machine.files import regular

FILES = "files"  # the name in the record


def described(picture: Path) -> dict[str, list[Any]]:
    """Return size in bytes, time in ns and hash of a picture, and of the .npz beside it if there is one, by suffix."""
    files = (picture.with_suffix(suffix) for suffix in (".png", ".npz"))
    return {file.suffix: [*_size_and_time(file), _hash(file)] for file in files if file.is_file()}


def are_as_written(picture: Path, suffixes: Iterable[str]) -> bool:
    """Whether a picture's record and its files with these suffixes are there and as they were written.

    Of records of earlier versions, which describe no files, the files need only be there.
    """
    try:
        record = json.loads(regular(picture.with_suffix(".json")).read_bytes())
        written = record.get(FILES)
        for suffix in suffixes:
            file = picture.with_suffix(suffix)
            size, time = _size_and_time(file)
            if written is None:
                continue
            if [size, time] != written[suffix][:2] and (
                size != written[suffix][0] or _hash(file) != written[suffix][2]
            ):
                return False
    except (OSError, InputError, ValueError, TypeError, KeyError, IndexError, AttributeError, RecursionError):
        return False
    return True


def _size_and_time(file: Path) -> tuple[int, int]:
    about = file.stat()
    return about.st_size, about.st_mtime_ns


def _hash(file: Path) -> str:
    with regular(file).open("rb") as content:
        return hashlib.file_digest(content, lambda: hashlib.blake2b(digest_size=16)).hexdigest()
