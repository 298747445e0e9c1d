"""A row of the score table, and what identifies it."""

from __future__ import annotations

import json
import math
from collections import namedtuple
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Literal

from sucre_bench.arguments import checked
from sucre_bench.arrays import DataFrame, Series
from sucre_bench.errors import InputError
from sucre_bench.machine.text_formats import now, short_hash

if TYPE_CHECKING:
    import pyarrow

Status = Literal["ok", "failed", "skipped"]

# The metric of the row that stands for a restoration.
RESTORATION = "seconds"

# Ends the variant of a score on common pixels: see `results.common_scores`.
COMMON = "@common"


@dataclass(frozen=True, slots=True)
class Row:
    """One score, or the reason why there is none.

    The row of the metric "seconds" stands for the restoration as a whole: its status says whether the restoration
    failed or was skipped. A new Row has this metric by default.
    """

    dataset: str = ""
    scene: str = ""
    view: str = ""

    method: str = ""
    """Label of the configuration."""

    options: str = "{}"
    """All the configuration's options as JSON."""

    options_id: str = ""
    """Hash of `options`."""

    metric: str = RESTORATION
    variant: str = "wall"

    region: str = "image"
    """It is "image", a chart, or "<chart>/<patch>"."""

    value: float = math.nan
    unit: str = "s"
    better: str = "lower"
    n_pixels: int = 0

    coverage: float = 1.0
    """Share of the region's pixels that were scored."""

    status: Status = "ok"
    """It is "ok", "failed" or "skipped". Unless it is "ok", `value` is NaN and `reason` says why."""

    reason: str = ""

    seconds: float = math.nan
    """Wall time of the restoration."""

    peak_mb: float = math.nan
    """Memory of the restoration above that held before, with that of the GPU, in MB."""

    device: str = "cpu"
    seed: int = 0

    code: str = ""
    """Hashes of the source code of the method and of the metric, see `RowCode`."""

    data_id: str = ""
    """Hash of the data."""

    time: str = field(default_factory=now)
    """UTC, ISO 8601."""


_DIGITS = 12


@dataclass(frozen=True)
class RowCode:
    """What made a row."""

    restoration: str
    """Hash of the code that restored, 12 digits, followed by that of the charts which the method looked at."""

    metric: str = ""
    """Hash of the metric's source; "-" and a hash of its options follow if it has any. Empty for a restoration."""

    seen: str = ""
    """Hash of the charts, or of the restored views, that the metric looked at."""

    mask: str = ""
    """Hash of the common pixels that were scored."""

    @classmethod
    def read(cls, text: str) -> RowCode:
        """Return what a row of a score on own pixels says."""
        return cls(*text.split(".", 2))

    def __str__(self) -> str:
        return ".".join(filter(None, (self.restoration, self.metric, self.seen, self.mask)))

    @property
    def method(self) -> str:
        """The hash of the code that restored, without charts."""
        return self.restoration[:_DIGITS]

    @property
    def metric_options(self) -> str:
        """The hash of the metric's options; empty if it has none."""
        return self.metric.partition("-")[2]


def code_parts(codes: Series) -> DataFrame:
    """Return hashes in the codes of rows, a column each: restoration, metric and method, see `RowCode`."""
    import pandas as pd

    texts = codes.unique()
    parts = [(read.restoration, read.metric, read.method) for read in map(RowCode.read, texts)]
    names = ["restoration", "metric", "method"]
    return pd.DataFrame(parts, texts, names, dtype=object).loc[codes].set_axis(codes.index)


def replicated(scene: str, replicate: int) -> str:
    """A scene's name as rows keep it: every replicate but the first says which it is."""
    return f"{scene},replicate={replicate}" if replicate else scene


def unreplicated(scene: str) -> tuple[str, int]:
    """A scene's name as the dataset gives it, and the replicate, from what a row says."""
    name, found, replicate = scene.rpartition(",replicate=")
    return (name, int(replicate)) if found and replicate.isdecimal() else (scene, 0)


COLUMNS = tuple(f.name for f in fields(Row))
# The columns that identify a restoration.
KEYS = ("dataset", "scene", "view", "method")
# Columns that are not text, by their type.
NUMBERS = {
    "value": "float64",
    "n_pixels": "int64",
    "coverage": "float64",
    "seconds": "float64",
    "peak_mb": "float64",
    "seed": "int64",
}


# The score that people's votes give a method: `sucre-bench study` writes it, no plugin computes it.
PREFERENCE = "preference"


def fingerprint(values: Mapping[str, Any]) -> tuple[str, str]:
    """Return options as canonical JSON, and a short hash of that."""
    text = json.dumps(dict(values), sort_keys=True, default=str)
    return text, short_hash(text)


def frame(rows: Iterable[Row]) -> DataFrame:
    """Return rows as a table with all columns; the columns' types do not depend on the rows."""
    return as_arrow(list(rows)).to_pandas(use_threads=False)


def as_arrow(rows: Sequence[Row]) -> pyarrow.Table:
    """Return rows as a table for parquet files, with the columns and types of `frame`."""
    import pyarrow

    types = {name: pyarrow.type_for_alias(NUMBERS.get(name, "string")) for name in COLUMNS}
    columns = [
        pyarrow.array(list(map(attrgetter(name), rows)), type=types[name]) for name in COLUMNS
    ]
    return pyarrow.Table.from_arrays(columns, schema=pyarrow.schema(types.items()))


def values_of(rows: DataFrame, *columns: str) -> Iterator[tuple[Any, ...]]:
    """Yield each row as a tuple of these columns: 20 times as fast as pandas does with text."""
    return zip(*(rows[name].astype(object).tolist() for name in columns), strict=True)


def tuples(rows: DataFrame, *columns: str) -> Iterator[Any]:
    """Yield each row as a named tuple of these columns, default all."""
    chosen = columns or tuple(map(str, rows.columns))
    kind = namedtuple("Tuple", chosen, rename=True)  # type: ignore[misc]
    return map(kind._make, values_of(rows, *chosen))


def row_objects(rows: DataFrame) -> Iterator[Row]:
    """Yield each row of a table as a `Row`, without the columns that a `Row` does not have."""
    return (Row(*values) for values in values_of(rows, *COLUMNS))


def restoration_rows(rows: DataFrame) -> DataFrame:
    """Return the rows that stand for restorations, one for each view by each method: see `Row`."""
    return rows[rows["metric"] == RESTORATION]


def restorations(rows: DataFrame) -> DataFrame:
    """Return the rows that stand for restorations that ended well: one a view and method, see `Row`."""
    return restoration_rows(rows[(rows["status"] == "ok") & (rows["view"] != "")])


def is_of_common_pixels(rows: DataFrame) -> Series:
    """Return which rows of a stored table are about common pixels."""
    variants = rows["variant"].drop_duplicates()
    return rows["variant"].isin(variants[variants.str.endswith(COMMON)])


By = Literal["method", "view", "region"]


# What a restoration takes: shown with the scores, but nobody wins by it.
COSTS = ("seconds", "peak_mb")


_FORMULA = ("=", "+", "-", "@")  # how it begins


def csv_text(table: DataFrame, for_spreadsheets: bool = False) -> str:
    """Return a table as CSV without its index, lines ending in one newline. NaN: an empty cell.

    for_spreadsheets: put an apostrophe before text that a spreadsheet would take for a formula, such as "=1+1".

    pandas alone writes numbers as numpy prints them, and packages alter that for a whole process: importing
    colour-science leaves 12 digits of 17.
    """
    if for_spreadsheets:
        table = table.map(
            lambda cell: (
                f"'{cell}" if isinstance(cell, str) and cell.startswith(_FORMULA) else cell
            )
        )
    return str(table.to_csv(index=False, lineterminator="\n", float_format=float.__repr__))


@checked
def wide(rows: DataFrame) -> DataFrame:
    """Return scores with one row for each view and method, and one column for each metric.

    - rows: the score table, from `sb.score`, `results.read` or scores.parquet.

    The score of a chart metric is the mean over the view's charts; scores of single patches are left out. So means of
    this table do not mix charts with their patches, as ``groupby(["method", "metric"]).value.mean()`` of the rows
    would. A column is called "metric", or "metric:variant" if the rows hold several variants of it. NaN: no score.

    >>> import pandas as pd
    >>> rows = pd.DataFrame({
    ...     "dataset": "dive", "scene": "reef", "view": "a.png", "method": "sucre", "metric": "psi",
    ...     "variant": "colour", "region": ["near", "far", "near/red"], "value": [4.0, 6.0, 90.0], "status": "ok"})
    >>> float(wide(rows)["psi"].iloc[0])
    5.0
    """
    needed = (*KEYS, "metric", "variant", "region", "value", "status")
    absent = [name for name in needed if name not in getattr(rows, "columns", ())]
    if absent:
        remedy = "pass the table that sucre_bench.score returns"
        raise InputError(f"has no column '{absent[0]}'", "wide(rows)", remedy)
    scores = rows[(rows["status"] == "ok") & ~rows["region"].str.contains("/", regex=False)]
    several = rows.groupby("metric")["variant"].nunique() > 1
    full = scores["metric"] + ":" + scores["variant"]
    name = full.where(scores["metric"].map(several).astype(bool), scores["metric"])
    order = list(dict.fromkeys(name))
    table = (
        scores.assign(_name=name)
        .groupby([*KEYS, "_name"], sort=False)["value"]
        .mean()
        .unstack("_name")
    )
    every = rows.loc[rows["view"] != "", list(KEYS)].drop_duplicates()
    table = table.reindex(index=every.set_index(list(KEYS)).index, columns=order)
    return table.rename_axis(columns=None)
