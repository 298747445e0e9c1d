"""The score table: its parts are joined while jobs write and others read; reasons; rows."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from sucre_bench import plugins, results
from sucre_bench.results import Reason, brief, with_remedy
from sucre_bench.results.reasons import without_view
from sucre_bench.results.rows import Row, frame
from sucre_bench.results.table import Part, merge, read

ROW = Row(
    dataset="sea", scene="reef", view="a.png", method="m", options="{}", options_id="o1", metric="psnr",
    variant="masked", region="image", value=1.0, unit="dB", better="higher", n_pixels=4, coverage=0.5, status="ok",
    reason="", seconds=1.0, peak_mb=2.0, device="cpu", seed=0, code="c1.p", data_id="d1",
    time="2026-01-01T00:00:00.000000+00:00",
)  # fmt: skip
LATER = "2026-01-02T00:00:00.000000+00:00"


def write(out: Path, job: str, *rows: Row) -> None:
    part = Part(out, job)
    part.add(rows)
    part.flush()


def test_a_newer_score_replaces_all_regions_of_the_older(tmp_path: Path):
    """A chart that is no longer there must not stay in the table."""
    write(tmp_path, "one", replace(ROW, region="chart1"), replace(ROW, region="chart2"))
    write(tmp_path, "two", replace(ROW, region="chart1", value=2.0, time=LATER))
    assert read(tmp_path)[["region", "value"]].to_numpy().tolist() == [["chart1", 2.0]]


@pytest.mark.parametrize("change", [{"options_id": "o2"}, {"data_id": "d2"}, {"code": "c2.p"}])
def test_scores_of_other_options_data_or_code_are_not_mixed(
    tmp_path: Path, change: dict[str, str]
):
    write(tmp_path, "one", ROW, replace(ROW, metric="ssim"))
    write(tmp_path, "two", replace(ROW, value=2.0, time=LATER, **change))
    assert read(tmp_path)["metric"].tolist() == ["psnr"]


def test_rows_of_one_method_are_read_as_they_are_among_all(tmp_path: Path):
    rows = [
        replace(ROW, method=m, view=v, dataset=d)
        for d in ("sea", "lake")
        for m in "ab"
        for v in ("1", "2")
    ]
    write(tmp_path, "one", *rows)
    merge(tmp_path)
    write(tmp_path, "two", replace(rows[0], value=5.0, time=LATER))
    whole = read(tmp_path)
    for dataset, method in (("sea", "a"), ("lake", "b"), ("lake", "none")):
        own = whole[(whole["dataset"] == dataset) & (whole["method"] == method)].reset_index(
            drop=True
        )
        pd.testing.assert_frame_equal(read(tmp_path, dataset=dataset, method=method), own)


def test_columns_and_types_are_the_same_for_no_rows_and_many():
    assert frame([]).dtypes.to_dict() == frame([ROW, ROW]).dtypes.to_dict()


WHOLE = replace(ROW, metric="seconds", variant="wall")


def test_a_try_that_failed_leaves_no_older_scores_standing(tmp_path: Path):
    write(tmp_path, "one", WHOLE, ROW)
    write(tmp_path, "two", replace(WHOLE, status="failed", reason="boom", time=LATER))
    rows = read(tmp_path)
    assert rows[["metric", "status"]].to_numpy().tolist() == [["seconds", "failed"]]


def test_the_failure_of_a_whole_job_is_forgotten_once_it_works(tmp_path: Path):
    write(
        tmp_path,
        "one",
        replace(WHOLE, scene="", view="", data_id="", status="failed", reason="no data"),
    )
    assert read(tmp_path)["status"].tolist() == ["failed"]
    write(tmp_path, "two", replace(WHOLE, time=LATER))
    assert read(tmp_path)["status"].tolist() == ["ok"]


@pytest.mark.parametrize(
    "has", [frozenset(), frozenset({"depth"}), frozenset({"charts", "poses"})]
)
def test_a_lack_is_known_by_its_code_and_names_what_is_there(has: frozenset[str]):
    text = plugins.missing_needs(plugins.find("method", "sucre"), has, "view")
    assert Reason.of(text) is Reason.LACK
    assert brief(text) == f"needs {' and '.join(sorted({'depth', 'poses'} - has))}"
    assert text.endswith(f"the view has {', '.join(sorted(has)) or 'only images'}")


def test_a_reason_of_a_methods_own_words_is_kept_whole():
    text = "too dark, nothing to score in this view"
    assert Reason.of(text) is Reason.OTHER
    assert brief(text) == text


@pytest.mark.parametrize(
    "text", ["a.png has no depth map", "a.png: has no depth map", "has no depth map"]
)
def test_views_with_one_reason_count_together(text: str):
    assert without_view(text, "a.png") == "has no depth map"
    assert without_view(text, "") == text


def test_a_number_that_a_view_is_named_like_stays_in_its_reason():
    near = "1.5 m is too near"
    assert without_view(near, "1") == near


def test_who_lacks_depth_or_poses_is_told_the_command_that_makes_them():
    method = plugins.find("method", "sucre")
    assert "sucre-bench prepare" in with_remedy(
        plugins.missing_needs(method, frozenset({"poses"}))
    )
    charts = plugins.missing_needs(plugins.find("metric", "psi"), frozenset())
    assert with_remedy(charts) == charts


# how files are read and changed
TOUCHES = (
    "iterdir",
    "read_bytes",
    "replace",
    "rmdir",
    "stat",
    "unlink",
)


def write_views(out: Path, *views: str) -> None:
    """Rows as a job leaves them, a part each."""
    for view in views:
        write(out, "job", replace(ROW, view=view))


def views_in(rows: Any) -> list[str]:
    return sorted(rows["view"])


class Moments:
    """Lets something happen when files are touched for the n-th time, in this thread, by what is within a `with`."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._patching, self._left, self._happen = monkeypatch, 0, lambda: None
        for name in TOUCHES:
            monkeypatch.setattr(Path, name, self._touching(getattr(Path, name)))

    def at(self, n: int, happen: Callable[[], None]) -> None:
        self._left, self._happen = n, happen

    @property
    def came(self) -> bool:
        return self._left <= 0

    def _touching(self, touch: Callable[..., Any]) -> Callable[..., Any]:
        def touched(*given: Any, **options: Any) -> Any:
            if threading.current_thread() is threading.main_thread():
                self._left -= 1
                if self._left == 0:
                    self._happen()
            return touch(*given, **options)

        return touched


@pytest.fixture
def moments(monkeypatch: pytest.MonkeyPatch) -> Moments:
    return Moments(monkeypatch)


def test_a_job_that_writes_while_parts_are_joined_loses_nothing_and_waits_for_nobody(
    tmp_path: Path, moments: Moments
):
    """Whatever moment it writes at. Hundreds of jobs that write each second would queue for one lock."""
    for n in range(1, 100):
        out = tmp_path / str(n)
        write_views(out, "before 1", "before 2")
        done = threading.Event()

        def late(out: Path = out, done: threading.Event = done) -> None:
            threading.Thread(
                target=lambda: (write_views(out, "late"), done.set()), daemon=True
            ).start()
            assert done.wait(300), "the job waits for the merge"

        moments.at(n, late)
        results.merge(out)
        if not moments.came:
            break
        expected = ["before 1", "before 2", "late"]
        assert views_in(results.read(out)) == views_in(results.merge(out)[0]) == expected, (
            f"at touch {n}"
        )
        assert not list((out / "parts").glob("*.parquet"))
    assert n > 6, "a merge touches more files than that"


def test_who_reads_while_parts_are_joined_sees_every_row(tmp_path: Path, moments: Moments):
    for n in range(1, 50):
        out = tmp_path / str(n)
        write_views(out, "0.png", "1.png", "2.png")
        moments.at(n, lambda out=out: views_in(results.merge(out)[0]))
        assert views_in(results.read(out)) == ["0.png", "1.png", "2.png"], f"at touch {n}"
        if not moments.came:
            break
    assert n > 4


def test_a_merge_that_was_killed_leaves_every_row_to_the_next(tmp_path: Path, moments: Moments):
    def killed() -> None:
        raise KeyboardInterrupt

    for n in range(1, 100):
        out = tmp_path / str(n)
        write_views(out, "a.png", "b.png")
        moments.at(n, killed)
        try:
            results.merge(out)
            break
        except KeyboardInterrupt:
            moments.at(0, killed)
        assert (
            views_in(results.read(out)) == views_in(results.merge(out)[0]) == ["a.png", "b.png"]
        ), f"at touch {n}"
    assert n > 6
