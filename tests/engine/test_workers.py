"""Several workers share the views of all jobs; the rows do not depend on how many there are."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
from support.command_line import run_here
from support.places import TOYS

from sucre_bench import results

FIXED = [
    "run",
    "-m",
    "--plugin",
    str(TOYS),
    "dataset=stages",
    "metrics=[coverage,uciqe]",
    "report=false",
]


def rows_of(folder: Path, *words: str) -> pd.DataFrame:
    done = run_here(folder, *FIXED, "tracking.uri=off", f"out={folder / 'results'}", *words)
    assert done.returncode == 0, done.stderr
    return results.read(folder / "results")


def test_rows_do_not_depend_on_the_number_of_workers(tmp_path: Path):
    found = []
    for n_workers in (1, 3):
        folder = tmp_path / str(n_workers)
        folder.mkdir()
        rows = rows_of(folder, "method=named,gray_world", f"workers={n_workers}")
        used = rows[rows["method"] == "named"]["device"].nunique()
        assert (used == 1) == (n_workers == 1), "one worker, or several for one method"
        found.append(
            rows[~rows["metric"].isin(["seconds", "peak_mb"])].drop(
                columns=["time", "seconds", "peak_mb", "device"]
            )
        )
    pd.testing.assert_frame_equal(*found)


def test_one_worker_does_all_views_of_a_scene_for_a_method_that_sees_them_together(
    tmp_path: Path,
):
    rows = rows_of(tmp_path, "method=named", "named.sees_whole_scene=true", "workers=4")
    assert rows.groupby("scene")["device"].nunique().to_dict() == {"left": 1, "right": 1}
    assert rows["view"].nunique() == 8


def test_where_no_second_worker_can_make_the_method_the_first_does_all_views(tmp_path: Path):
    rows = rows_of(tmp_path, "method=named", "named.fits_once=true", "workers=3")
    assert rows["device"].nunique() == 1
    assert rows["view"].nunique() == 8
