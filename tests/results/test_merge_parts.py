"""Parts are joined while jobs write, others read, and processes are killed: no row is lost or seen twice."""

import errno
import fcntl
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from sucre_bench import results
from sucre_bench.results.rows import Row
from sucre_bench.results.table import Part

TOUCHES = ("iterdir", "read_bytes", "replace", "rmdir", "stat", "unlink")  # how files are read and changed


def write(out: Path, *views: str) -> None:
    """Rows as a job leaves them, a part each."""
    for view in views:
        part = Part(out, "job")
        part.add([Row(dataset="d", scene="s", view=view, method="m", value=1.0)])
        part.flush()


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


def test_a_job_that_writes_while_parts_are_joined_loses_nothing_and_waits_for_nobody(tmp_path: Path, moments: Moments):
    """Whatever moment it writes at. Hundreds of jobs that write each second would queue for one lock."""
    for n in range(1, 100):
        out = tmp_path / str(n)
        write(out, "before 1", "before 2")
        done = threading.Event()

        def late(out: Path = out, done: threading.Event = done) -> None:
            threading.Thread(target=lambda: (write(out, "late"), done.set()), daemon=True).start()
            assert done.wait(300), "the job waits for the merge"

        moments.at(n, late)
        results.merge(out)
        if not moments.came:
            break
        expected = ["before 1", "before 2", "late"]
        assert views_in(results.read(out)) == views_in(results.merge(out)) == expected, f"at touch {n}"
        assert not list((out / "parts").glob("*.parquet"))
    assert n > 6, "a merge touches more files than that"


def test_who_reads_while_parts_are_joined_sees_every_row(tmp_path: Path, moments: Moments):
    for n in range(1, 50):
        out = tmp_path / str(n)
        write(out, "0.png", "1.png", "2.png")
        moments.at(n, lambda out=out: views_in(results.merge(out)))
        assert views_in(results.read(out)) == ["0.png", "1.png", "2.png"], f"at touch {n}"
        if not moments.came:
            break
    assert n > 4


def test_a_merge_that_was_killed_leaves_every_row_to_the_next(tmp_path: Path, moments: Moments):
    def killed() -> None:
        raise KeyboardInterrupt

    for n in range(1, 100):
        out = tmp_path / str(n)
        write(out, "a.png", "b.png")
        moments.at(n, killed)
        try:
            results.merge(out)
            break
        except KeyboardInterrupt:
            moments.at(0, killed)
        assert views_in(results.read(out)) == views_in(results.merge(out)) == ["a.png", "b.png"], f"at touch {n}"
    assert n > 6


def no_locks_here(*_: object, **__: object) -> None:
    """What `flock` does on a file system without locks."""
    raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))


def test_commands_that_end_together_on_a_file_system_without_locks_lose_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(fcntl, "flock", no_locks_here)

    def work(number: int) -> None:
        write(tmp_path, f"{number}.png")
        results.merge(tmp_path)

    with ThreadPoolExecutor(3) as together:
        list(together.map(work, range(12)))
    assert views_in(results.read(tmp_path)) == sorted(f"{number}.png" for number in range(12))
    assert not list(tmp_path.glob("*.held"))
    assert not (tmp_path / "parts").exists()
