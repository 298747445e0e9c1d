"""Rows while they are read: each column of text as numbers that point to its different texts.

Most texts of a table are the same in thousands of rows. Encoded, a row takes a fifth of the memory, and checks look at
each text once. `as_frame` writes the texts out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sucre_bench.arrays import DataFrame
from sucre_bench.results.rows import COLUMNS, NUMBERS, frame

if TYPE_CHECKING:
    import pyarrow

TEXTS = tuple(name for name in COLUMNS if name not in NUMBERS)


def encoded(rows: pyarrow.Table) -> pyarrow.Table:
    """Return the columns of rows, one chunk each, all text columns encoded. Other columns are left out."""
    import pyarrow

    columns = [
        rows[name].cast(NUMBERS[name], safe=False) if name in NUMBERS else _distinct(rows[name]) for name in COLUMNS
    ]
    return pyarrow.Table.from_arrays(columns, names=list(COLUMNS)).combine_chunks()


def _distinct(column: pyarrow.ChunkedArray) -> pyarrow.ChunkedArray:
    """A column of text, encoded or not, as numbers of 32 bits that point to distinct texts."""
    import pyarrow

    text, number = pyarrow.large_string(), pyarrow.int32()
    chunks = [
        pyarrow.DictionaryArray.from_arrays(chunk.indices.cast(number), chunk.dictionary.cast(text))
        if pyarrow.types.is_dictionary(chunk.type)
        else chunk.cast(text).dictionary_encode()
        for chunk in column.chunks
    ]
    whole = pyarrow.chunked_array(chunks, pyarrow.dictionary(number, text)).unify_dictionaries()
    texts = whole.chunk(0).dictionary if whole.num_chunks else []
    return whole if len(set(texts)) == len(texts) else whole.cast(text).dictionary_encode()


def joined(tables: Sequence[pyarrow.Table]) -> pyarrow.Table:
    """Return encoded rows, one table after the other; no rows of no table."""
    import pyarrow

    if not tables:
        return encoded(pyarrow.Table.from_pandas(frame([]), preserve_index=False))
    return pyarrow.concat_tables(tables).unify_dictionaries().combine_chunks()


def texts_of(column: pyarrow.ChunkedArray) -> list[str]:
    """Return the distinct texts of an encoded column, in any order; some may be of rows that are left out by now."""
    texts: list[str] = column.combine_chunks().dictionary.to_pylist()
    return texts


def of_label(rows: pyarrow.Table, column: str, label: str) -> pyarrow.Table:
    """Return the encoded rows that have a label in a column."""
    from pyarrow import compute

    held = rows[column].combine_chunks()
    place = compute.index(held.dictionary, label)
    return rows.filter(compute.equal(held.indices, place.cast(held.indices.type)))


def as_frame(rows: pyarrow.Table) -> DataFrame:
    """Return encoded rows as a table of pandas, its texts written out."""
    import pyarrow

    text = pyarrow.large_string()
    columns = [rows[name] if name in NUMBERS else rows[name].cast(text) for name in COLUMNS]
    return (
        pyarrow.Table.from_arrays(columns, names=list(COLUMNS))
        .to_pandas(use_threads=False)
        .astype(frame([]).dtypes.to_dict())
    )
