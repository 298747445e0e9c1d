"""Chooses the row that counts if there are several rows of one score."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sucre_bench.results.rows import _RESTORATION, RESTORATION

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow

__all__ = ["newest"]


def newest(rows: pyarrow.Table) -> pyarrow.Table:
    """Keep the newest of each score, and of each restoration only what belongs to its newest try.

    Scores of other options, data or code are not mixed, and a try that failed leaves no older scores standing. In the
    order of `results.table.read`. rows: encoded.
    """
    if not len(rows):
        return rows
    keys = _numbered(rows)
    keys["restoration"] = keys.groupby(_RESTORATION).ngroup()
    keys["score"] = keys.groupby(["restoration", "metric", "variant"]).ngroup()
    kept = keys.sort_values("time", kind="stable")
    same = ["options_id", "data_id", "code"]
    kept = kept[(kept[same] == kept.groupby("restoration")[same].transform("last")).all(axis=1)]
    ended = kept["time"].where(kept["has_ended"], -1)
    kept = kept[kept["time"] >= ended.groupby(kept["restoration"]).transform("max")]
    # A row of a whole job that failed stands until the job has done anything since.
    kept = kept[~kept["of_job"] | (kept["time"] == kept.groupby(["dataset", "method"])["time"].transform("max"))]
    kept = kept[kept["time"] == kept.groupby("score")["time"].transform("max")]
    kept = kept.drop_duplicates(["score", "region"]).sort_index()
    kept = kept.sort_values(["dataset", "method", "scene", "view"], kind="stable")
    chosen = kept.index.to_numpy()
    return rows if np.array_equal(chosen, np.arange(len(rows))) else rows.take(chosen)


def _numbered(rows: pyarrow.Table) -> pd.DataFrame:
    """The columns that decide which rows count, each text as its place in the order of its column's texts.

    code: of the restoration alone; has_ended: whether the row says that a restoration failed or was skipped; of_job:
    whether it speaks for a job as a whole.
    """
    import pandas as pd

    names = [*_RESTORATION, "metric", "variant", "region", "time", "options_id", "data_id"]
    keys = pd.DataFrame({name: _places(rows, name) for name in names})
    texts, codes = _texts(rows, "code")
    restorations = pd.factorize(np.array([code.split(".")[0] for code in texts], dtype=object))[0]
    has_ended = _is(rows, "metric", RESTORATION) & ~_is(rows, "status", "ok")
    return keys.assign(code=restorations[codes], has_ended=has_ended, of_job=_is(rows, "view", ""))


def _texts(rows: pyarrow.Table, name: str) -> tuple[list[str], npt.NDArray[np.int32]]:
    """A column's distinct texts, and which of them each row has."""
    held = rows[name].combine_chunks()
    return held.dictionary.to_pylist(), held.indices.to_numpy()


def _places(rows: pyarrow.Table, name: str) -> npt.NDArray[np.int64]:
    texts, numbers = _texts(rows, name)
    places = np.empty(len(texts), dtype=np.int64)
    places[sorted(range(len(texts)), key=texts.__getitem__)] = np.arange(len(texts))
    return places[numbers]


def _is(rows: pyarrow.Table, name: str, text: str) -> npt.NDArray[np.bool_]:
    texts, numbers = _texts(rows, name)
    return np.array([one == text for one in texts], dtype=np.bool_)[numbers]
