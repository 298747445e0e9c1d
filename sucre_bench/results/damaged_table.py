"""Checks a file of rows when it is read: the types of its columns, and the values that other code relies on."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from sucre_bench.errors import DamagedFileError, in_one_line
from sucre_bench.results.encoded_rows import texts_of
from sucre_bench.results.rows import COLUMNS, NUMBERS, Status

if TYPE_CHECKING:
    import pyarrow

_MOST_ROWS = 50_000_000  # a few bytes of parquet may stand for any number of equal rows
_KINDS = {"string": "text", "int64": "whole numbers", "float64": "numbers"}
_WORDS: Mapping[str, tuple[str, ...]] = {"status": get_args(Status), "better": ("higher", "lower", "none")}
_TIME = re.compile(r"\d{4}-\d\d-\d\d")
_MAY_BE_ABSENT = ("value", "coverage", "seconds", "peak_mb")  # NaN, which some writers store as null


def damaged(path: Path, fault: str) -> DamagedFileError:
    """Return the error for a file of rows that cannot be used."""
    return DamagedFileError(f"not a table of scores, {fault}", path, "restore a copy, or delete it and run again")


def check_columns(path: Path, file: pyarrow.parquet.ParquetFile) -> None:
    """Raise DamagedFileError unless a file has every column of a row, each of its type. Other columns are ignored."""
    schema = file.schema_arrow
    if absent := [name for name in COLUMNS if name not in schema.names]:
        raise damaged(path, f"it lacks {', '.join(absent)}")
    if twice := [name for name in COLUMNS if schema.names.count(name) > 1]:
        raise damaged(path, f"it has two columns '{twice[0]}'")
    for name in COLUMNS:
        wanted = NUMBERS.get(name, "string")
        if not _is(wanted)(schema.field(name).type):
            found = in_one_line(schema.field(name).type)
            raise damaged(path, f"its column '{name}' holds {found}, not {_KINDS[wanted]}")
    if file.metadata.num_rows > _MOST_ROWS:
        raise damaged(path, f"it has {file.metadata.num_rows} rows, more than {_MOST_ROWS}")


def _is(wanted: str) -> Callable[[Any], bool]:
    """Whether a column's type can be read as the wanted one, without loss."""
    from pyarrow import types

    if wanted == "string":
        return lambda found: _is_text(found.value_type if types.is_dictionary(found) else found)
    if wanted == "int64":
        return lambda found: bool(types.is_integer(found)) and not types.is_uint64(found)
    return lambda found: bool(types.is_integer(found) or types.is_floating(found))


def _is_text(found: Any) -> bool:
    from pyarrow import types

    return bool(types.is_string(found) or types.is_large_string(found) or types.is_string_view(found))


def check_values(path: Path, rows: pyarrow.Table) -> None:
    """Raise DamagedFileError, with the column and the first row, for a value that no row can have. rows: encoded."""
    from pyarrow import compute

    for name in COLUMNS:
        if name not in _MAY_BE_ABSENT:
            _refuse(path, rows[name].is_null(), f"column '{name}' is empty")
    for name, words in _WORDS.items():
        _refuse_texts(path, rows[name], words.__contains__, f"column '{name}' is none of {', '.join(words)}")
    _refuse_texts(path, rows["time"], _TIME.match, "column 'time' is no time")
    _refuse_texts(path, rows["options"], _is_json_object, "column 'options' is no JSON object")
    _refuse(path, compute.less(rows["n_pixels"], 0), "column 'n_pixels' is negative")


def _refuse_texts(path: Path, column: pyarrow.ChunkedArray, is_right: Callable[[str], Any], fault: str) -> None:
    """Refuse a column of text if one of its distinct texts is wrong."""
    from pyarrow import array, compute

    wrong = [text for text in texts_of(column) if not is_right(text)]
    if wrong:
        texts = column.cast("large_string")
        _refuse(path, compute.is_in(texts, value_set=array(wrong, texts.type)), fault)


def _refuse(path: Path, is_wrong: pyarrow.ChunkedArray, fault: str) -> None:
    from pyarrow import compute

    row = compute.index(is_wrong, True).as_py()
    if row >= 0:
        raise damaged(path, f"{fault} (row {row + 1})")


def _is_json_object(text: str) -> bool:
    try:
        return isinstance(json.loads(text), dict)
    except (ValueError, RecursionError):
        return False
