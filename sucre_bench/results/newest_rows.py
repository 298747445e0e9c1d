"""Chooses the row that counts if there are several rows of one score, and the rows of the newest data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import DataFrame, Indices, Mask, Series
from sucre_bench.results.rows import KEYS, RESTORATION

if TYPE_CHECKING:
    import pyarrow


def newest(rows: pyarrow.Table) -> pyarrow.Table:
    """Keep the newest of each score, and of each restoration only what belongs to its newest try.

    Scores of other options, data or code are not mixed, and a try that failed leaves no older scores standing. In the
    order of `results.table.read`. rows: encoded.
    """
    if not len(rows):
        return rows
    of = _Rows(rows)
    restoration = of.group(*KEYS)
    score = of.group("metric", "variant", within=restoration)
    last = of.last(restoration, np.ones(len(rows), dtype=np.bool_))
    code = of.numbers("code", lambda text: text.split(".")[0])  # of the restoration alone
    kept = np.logical_and.reduce(
        [values == values[last] for values in (of.numbers("options_id"), of.numbers("data_id"), code)]
    )
    has_ended = of.are("metric", RESTORATION) & ~of.are("status", "ok")
    kept &= of.time >= of.latest(restoration, kept & has_ended)
    # A row of a whole job that failed stands until the job has done anything since.
    kept &= ~of.are("view", "") | (of.time == of.latest(of.group("dataset", "method"), kept))
    kept &= of.time == of.latest(score, kept)
    chosen = np.flatnonzero(kept)
    _, first = np.unique(of.group("region", within=score)[chosen], return_index=True)
    chosen = chosen[np.sort(first)]
    chosen = chosen[np.lexsort([of.places(name)[chosen] for name in ("view", "scene", "method", "dataset")])]
    return rows if np.array_equal(chosen, np.arange(len(rows))) else rows.take(chosen)


def is_fresh(rows: DataFrame) -> Series:
    """Return which rows come from the newest data of their scene."""
    import pandas as pd

    data = rows[["dataset", "scene", "data_id"]].drop_duplicates()
    if not data.duplicated(["dataset", "scene"]).any():  # as in most folders: no scene has older data too
        return pd.Series(data=True, index=rows.index)
    newest = rows.groupby(["dataset", "scene", "data_id"])["time"].transform("max")
    return newest == newest.groupby([rows["dataset"], rows["scene"]]).transform("max")


@dataclass(frozen=True, eq=False)
class _Rows:
    """The columns of encoded rows as numbers: they take a tenth of the texts' memory and time."""

    rows: pyarrow.Table

    def numbers(self, name: str, what: Callable[[str], str] = str) -> Indices:
        """A number for each row, equal where a column's texts are; what: the part of a text that counts."""
        texts, numbers = self._texts(name)
        known: dict[str, int] = {}
        return np.array([known.setdefault(what(text), len(known)) for text in texts], dtype=np.int64)[numbers]

    def places(self, name: str) -> Indices:
        """The place of each row's text in the order of its column's texts."""
        texts, numbers = self._texts(name)
        places = np.empty(len(texts), dtype=np.int64)
        places[sorted(range(len(texts)), key=texts.__getitem__)] = np.arange(len(texts))
        return np.asarray(places[numbers])

    def are(self, name: str, text: str) -> Mask:
        """Whether the text of each row is this one."""
        texts, numbers = self._texts(name)
        return np.array([one == text for one in texts], dtype=np.bool_)[numbers]

    def _texts(self, name: str) -> tuple[list[str], npt.NDArray[np.int32]]:
        """A column's distinct texts, and which of them each row has."""
        column = self.rows[name].combine_chunks()
        return column.dictionary.to_pylist(), column.indices.to_numpy()

    def group(self, *names: str, within: Indices | None = None) -> Indices:
        """A number for each row, below their count, equal where all of these columns are, and `within` if given."""
        import pandas as pd

        group = np.zeros(len(self.rows), dtype=np.int64) if within is None else within
        for name in names:
            texts, numbers = self._texts(name)
            group = pd.factorize(group * len(texts) + numbers)[0]
        return group

    @cached_property
    def time(self) -> Indices:
        """Each row's time, as a place."""
        return self.places("time")

    @cached_property
    def _by_time(self) -> Indices:
        return np.argsort(self.time, kind="stable")

    def last(self, group: Indices, among: Mask) -> Indices:
        """For each row, the last one of its group in time, -1 if none of the group is among them."""
        last = np.full(len(group), -1, dtype=np.int64)
        rows = self._by_time[among[self._by_time]]
        last[group[rows]] = rows  # of several, the last one stays
        return np.asarray(last[group])

    def latest(self, group: Indices, among: Mask) -> Indices:
        """For each row, the latest time in its group, -1 if none of the group is among them."""
        last = self.last(group, among)
        return np.where(last < 0, -1, self.time[last])
