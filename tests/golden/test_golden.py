"""What commands come to, frozen: the jobs of every experiment and of 28 commands, and every score of every method.

`python tests/golden/test_golden.py FOLDER` writes scores.csv again from the results folder of SCORES, after a change
that is meant to change scores. jobs.json is changed by hand.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

HERE = Path(__file__).parent
KEYS = ["view", "metric", "variant", "region"]
COSTS = ("seconds", "peak_mb")
# Another processor ends the steps of a fit elsewhere in the last digits: most where a value is of 8-bit levels or a
# parameter that the views hardly tell.
FITS = ("gaussian_seathru", "haze_lines", "seathru", "sucre", "sucre_paper", "sucre_plus")
MOVES_MOST = ("uism", "uiqm", "uicm", "water", "water_parameters")
# A fault is a share of pixels, and a pixel at its limit crosses it.
TWO_PIXELS = 2.1 / (160 * 120)
GOLDEN: Sequence[Mapping[str, Any]] = json.loads(
    (HERE / "jobs.json").read_text(encoding="utf-8")
)
_OPTIONS = (
    "every",
    "first",
    "overwrite",
    "workers",
    "save",
    "bits",
    "seed",
    "report",
    "pairs_gb",
    "cache_gb",
)
_OPTIONS += ("cache_keep", "replicate", "baseline", "view_timeout_s")


def as_data(job: Any) -> dict[str, Any]:
    """What a job does: labels, names and options that are not as by default, metrics, and other settings."""
    from sucre_bench.jobs.rerun import given

    run = {
        name: value
        for name in _OPTIONS
        if (value := getattr(job, name)) != getattr(type(job), name)
    }
    run |= {"views": list(job.views)} if job.views is not None else {}
    run |= {"shard": [job.shard.index, job.shard.count]} if job.shard.count > 1 else {}
    run |= {"degrade": job.degrade.record} if job.degrade.record else {}
    if study := job.study:
        run |= {"study": study.name, "figures": list(study.figures), "along": study.along}
        run |= {"study.baseline": study.baseline, "columns": list(study.metrics)}
    return {
        "dataset": [
            job.dataset.label,
            job.dataset.plugin.name,
            given("dataset", job.dataset.record, job.seed),
        ],
        "method": [
            job.method.label,
            job.method.plugin.name,
            given("method", job.method.record, job.seed),
        ],
        "metrics": [
            f"{metric.plugin.name}:{variant}"
            for metric in job.metrics
            for variant in metric.variants
        ],
        "out": str(job.out),
        "run": run,
    }


@pytest.mark.parametrize("golden", GOLDEN, ids=lambda golden: " ".join(golden["command"]))
def test_a_command_has_these_jobs(
    golden: Mapping[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from support.colmap_folder import write_dive

    from sucre_bench.jobs import compose_jobs

    write_dive(tmp_path / "dive")
    monkeypatch.chdir(tmp_path)
    words = golden["command"]
    is_sweep = words[0] == "-m" or words[0].startswith("experiment=")
    found = compose_jobs.jobs([word for word in words if word != "-m"], is_sweep).jobs
    expected = [
        {**golden["shared"], **job, "run": golden["shared"]["run"] | job.get("run", {})}
        for job in golden["jobs"]
    ]
    assert json.loads(json.dumps([as_data(job) for job in found])) == expected


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """A row for each score, a column for each method: the value, or the status of a score without one."""
    rows = rows[~rows["metric"].isin(COSTS)]
    values = [
        f"{value:.9g}" if status == "ok" else status
        for value, status in rows[["value", "status"]].to_numpy()
    ]
    return rows.assign(value=values).pivot(index=KEYS, columns="method", values="value")


def test_every_method_has_these_scores(tmp_path: Path) -> None:
    """All methods that need no file by all variants of all metrics, on two views of the built-in scene."""
    from support.command_line import run

    from sucre_bench import results

    expected = pd.read_csv(HERE / "scores.csv", dtype=str, keep_default_na=False).set_index(
        KEYS
    )
    scene = [
        "dataset=demo",
        "dataset.width=160",
        "dataset.height=120",
        "dataset.views=8",
        "every=4",
    ]
    metrics = dict.fromkeys(f"{name}:all" for name in expected.index.get_level_values("metric"))
    chosen = [f"method={','.join(expected.columns)}", f"metrics=[{','.join(metrics)}]"]
    run(tmp_path / "out", *scene, *chosen, "report=false", multirun=True)
    found = table(results.read(tmp_path / "out"))
    assert set(found.index) == set(expected.index)
    assert set(found.columns) == set(expected.columns)
    found = found.loc[expected.index, expected.columns].fillna("")
    old, new = (
        one.apply(pd.to_numeric, errors="coerce").to_numpy() for one in (expected, found)
    )
    relative = np.full(old.shape, 1e-6)
    absolute = np.full(old.shape, 1e-6)
    is_fit = expected.columns.isin(FITS)
    metric = expected.index.get_level_values("metric")
    relative[:, is_fit] = 2e-4
    relative[np.ix_(metric.isin(MOVES_MOST), is_fit)] = 5e-3
    absolute[np.ix_(metric == "faults", is_fit)] = TWO_PIXELS
    is_other = ~np.isclose(new, old, rtol=relative, atol=absolute, equal_nan=True) | (
        np.isnan(old) & (expected.to_numpy() != found.to_numpy())
    )
    names = [
        f"{expected.columns[k]} {expected.index[i]}: {old[i, k]} -> {new[i, k]}"
        for i, k in np.argwhere(is_other)
    ]
    assert not names, "\n".join(names[:20])


if __name__ == "__main__":
    from sucre_bench import results

    table(results.read(sys.argv[1])).to_csv(HERE / "scores.csv")
