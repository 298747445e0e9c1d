"""The table of scores on common pixels, ``common.parquet``: of each view, scores on the pixels that all methods fill.

It stands beside the score table, where every score is on a method's own pixels. Its columns are those of `Row`, and
pixels: a hash of the common mask, "" where there is none; methods: those it is common to, as JSON.

A row of metric "common_pixels" stands for a view; its variant is a `Kind`, its value the share of the image.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from sucre_bench.arrays import DataFrame, Mask
from sucre_bench.errors import InputError
from sucre_bench.machine.files import write_atomically
from sucre_bench.results.bundle_format import open_bundle
from sucre_bench.results.restorations import mask_id
from sucre_bench.results.rows import COLUMNS, Row, restorations, values_of
from sucre_bench.results.table import is_bundle, read_file

COMMON_TABLE = "common.parquet"

# The metric of the row that stands for a view.
COMMON_PIXELS = "common_pixels"

# "equal": methods fill the same pixels, so nothing is scored; "common": they do not; "none": they share no pixel;
# "unknown": a mask or picture cannot be read.
Kind = Literal["equal", "common", "none", "unknown"]

# A view is scored on common pixels if more than this share of the image is filled by some methods only.
LEAST_DIFFERENCE = 0.01

# A method that fills a smaller share of an image would leave the others next to nothing: it has no score of this view.
LEAST_FILLED = 0.01

ViewKey = tuple[str, str, str]  # dataset, scene, view

_COLUMNS = (*COLUMNS, "pixels", "methods")


@dataclass(frozen=True, slots=True)
class CommonRow(Row):
    """A score on common pixels, or what is known of a view's common pixels."""

    pixels: str = ""
    methods: str = "[]"

    @classmethod
    def of(cls, row: Row, pixels: str, methods: Sequence[str] = ()) -> CommonRow:
        """Return a row with the hash of its mask, and the methods this is common to."""
        return cls(**{name: getattr(row, name) for name in COLUMNS}, pixels=pixels, methods=json.dumps(sorted(methods)))


def filled_restorations(rows: DataFrame) -> DataFrame:
    """Return the rows of restorations that fill enough of their view to take part."""
    whole = restorations(rows)
    return whole[whole["coverage"] >= LEAST_FILLED]


def differing_views(whole: DataFrame) -> set[ViewKey]:
    """Return the views that several methods restored, one of them with holes. whole: rows of restorations."""
    by_view = whole.groupby(["dataset", "scene", "view"], sort=False)
    may_differ = (by_view["method"].nunique() > 1) & (by_view["coverage"].min() < 1)
    return set(may_differ.index[may_differ])


@dataclass(frozen=True)
class CommonPixels:
    """The pixels of a view that all methods fill.

    mask: (H, W); share: of the image that they are; kind: whether scores are on them; id: hash of the mask, "" if no
    scores are on them.
    """

    mask: Mask
    share: float
    kind: Kind
    id: str


def common_pixels(masks: Mapping[str, Mask | None]) -> CommonPixels:
    """Return the pixels that all methods fill.

    masks: by method, the pixels (H, W) with a colour; None for a method that fills all of them, but not for all
    methods. Raises InputError for masks of different sizes.
    """
    holed = {name: mask for name, mask in masks.items() if mask is not None}
    (_, first), *others = holed.items()
    for name, mask in others:
        if mask.shape != first.shape:
            sizes = [f"{w}x{h}" for h, w in (mask.shape, first.shape)]
            fault, remedy = f"is {sizes[0]}, others are {sizes[1]}", "run that method again with overwrite=always"
            raise InputError(fault, f"the mask of {name}", remedy)
    common = np.logical_and.reduce([*holed.values()])
    some = 1.0 if len(holed) < len(masks) else float(np.logical_or.reduce([*holed.values()]).mean())
    share = float(common.mean())
    kind: Kind = "equal" if some - share <= LEAST_DIFFERENCE else "common" if common.any() else "none"
    return CommonPixels(common, share, kind, mask_id(common) if kind == "common" else "")


def common_frame(rows: Iterable[CommonRow]) -> DataFrame:
    """Return rows as a table."""
    import pandas as pd

    return pd.DataFrame([asdict(row) for row in rows], columns=list(_COLUMNS))


def common_rows(table: DataFrame) -> Iterator[CommonRow]:
    """Yield each row of a table as a `CommonRow`."""
    return (CommonRow(*values) for values in values_of(table, *_COLUMNS))


def read_common(*folders: Path) -> DataFrame:
    """Return the scores on common pixels of results folders and bundles; no rows if none were needed.

    Raises FileError if a table cannot be read, DamagedFileError if its content is none.
    """
    import pandas as pd

    tables = list[DataFrame | None]()
    for folder in folders:
        if is_bundle(folder):
            with open_bundle(folder) as bundle:
                tables.append(bundle.common)
        elif (rows := read_file(folder / COMMON_TABLE, columns=_COLUMNS)) is not None:
            tables.append(rows.to_pandas(use_threads=False))
    some = [table for table in tables if table is not None and len(table)]
    return pd.concat(some or [common_frame([])], ignore_index=True)


def write_common(out: Path, rows: DataFrame) -> None:
    """Write the table of a results folder as a whole. Raises OutputError if it cannot be written."""
    buffer = io.BytesIO()
    rows.to_parquet(buffer, index=False, write_page_checksum=True)
    write_atomically(out / COMMON_TABLE, buffer.getvalue())
