"""Scores as runs keep them, for studies, and what a study makes of them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from sucre_bench.reports.paper import Study, style, write_study
from sucre_bench.reports.paper import study_results as along
from sucre_bench.results.rows import Row, frame

ROW = Row(scene="reef", metric="psnr", variant="masked", unit="dB", better="higher", code="c", data_id="d")


def row(
    method: str,
    view: str,
    value: float,
    degrade: Mapping[str, Any] = {},
    dataset: Mapping[str, Any] = {"name": "sea"},
    options: Mapping[str, Any] = {},
    **about: Any,
) -> Row:
    """A score as a run keeps it; NaN is a failure."""
    said = {"name": method, "dataset": dict(dataset), **options, **({"degrade": dict(degrade)} if degrade else {})}
    label = ",".join([str(dataset["name"]), *(f"{k}={str(v).replace(', ', '_')}" for k, v in degrade.items())])
    status = {"status": "failed", "reason": "broke"} if np.isnan(value) else {}
    own = {"dataset": label, "method": method, "time": "2026-01-01", **status, **about}
    return replace(ROW, view=view, value=value, options=json.dumps(said), **own)


def noisy(values: Mapping[Any, Mapping[str, list[float]]], option: str = "depth_noise", **about: Any) -> pd.DataFrame:
    """Scores by value, method and view; None is the value of undegraded data, which no row says."""
    return frame(
        row(method, f"v{n}", score, {} if value is None else {option: value}, **about)
        for value, methods in values.items()
        for method, scores in methods.items()
        for n, score in enumerate(scores)
    )


def followed(rows: pd.DataFrame, option: str, **study: Any) -> along.Along:
    (one,) = along.along(rows, Study(name="s", along=option, **study))
    return one


def drawn(name: str, rows: pd.DataFrame, out: Path = Path("nowhere"), **study: Any) -> dict[str, Any]:
    """The figures of one kind, by the ends of their files' names."""
    with style.look():
        return dict(write_study.drawn(name, along.StudyResults(Study("s", **study), rows, out)))


def words(one: along.Along) -> list[str]:
    return [value.word for value in one.values]


def csv(out: Path, name: str = "s") -> pd.DataFrame:
    return pd.read_csv(out / "tables" / f"{name}.csv", keep_default_na=False, na_values=[""])
