from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest

from sucre_bench import results
from sucre_bench.results import table
from sucre_bench.results.rows import Row
from sucre_bench.results.table import Part


def row(view: str, **other) -> Row:
    return Row(dataset="d", scene="s", view=view, method="m", value=1.0, **other)


def test_a_job_that_writes_while_parts_are_joined_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Whatever moment it writes at: here each of the steps of a merge."""
    part = Part(tmp_path, "job")
    for step in ("_take", "_read", "_write_table"):
        part.add([row(f"before {step}")])
        part.flush()
        original = getattr(table, step)

        def late(*given, step=step, original=original):
            monkeypatch.setattr(table, step, original)
            done = original(*given)
            part.add([row(f"after {step}")])
            part.flush()
            return done

        monkeypatch.setattr(table, step, late)
        results.merge(tmp_path)
    views = {f"{when} {step}" for when in ("before", "after") for step in ("_take", "_read", "_write_table")}
    assert set(results.read(tmp_path)["view"]) == views
    assert set(results.merge(tmp_path)["view"]) == views
    assert not list((tmp_path / "parts").glob("*.parquet"))


def test_who_reads_while_parts_are_joined_sees_every_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for number in range(3):
        part = Part(tmp_path, f"job{number}")
        part.add([row(f"{number}.png")])
        part.flush()
    original = table._table

    def merged_before(*given: Any):
        monkeypatch.setattr(table, "_table", original)
        results.merge(tmp_path)
        return original(*given)

    monkeypatch.setattr(table, "_table", merged_before)
    assert set(results.read(tmp_path)["view"]) == {"0.png", "1.png", "2.png"}


def test_a_merge_that_was_killed_leaves_what_it_took_to_the_next(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    part = Part(tmp_path, "job")
    part.add([row("a.png")])
    part.flush()

    def killed(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(table, "_write_table", killed)
        with pytest.raises(KeyboardInterrupt):
            results.merge(tmp_path)
    assert list(results.read(tmp_path)["view"]) == ["a.png"]
    assert list(results.merge(tmp_path)["view"]) == ["a.png"]


def test_a_job_waits_for_nobody_to_write(tmp_path: Path):
    """Hundreds of jobs that write each second would queue for one lock, and some file systems have none."""
    done = threading.Event()

    def write() -> None:
        part = Part(tmp_path, "job")
        part.add([row("a.png")])
        part.flush()
        done.set()

    with table._locked(tmp_path):
        threading.Thread(target=write, daemon=True).start()
        assert done.wait(20)
