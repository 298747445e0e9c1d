"""Waits for the jobs of a sweep, and reports their states and how many views they have done."""

from __future__ import annotations

import io
import os
import pickle
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from sucre_bench import results
from sucre_bench.engine.slurm.squeue import ENDED
from sucre_bench.machine import progress

_SAY_S = 30.0  # between two lines


class Teller:
    """Says now and then how jobs and views stand."""

    def __init__(self, out: Path) -> None:
        self._parts = out / results.PARTS
        self._before = set(self._parts.glob("*.parquet"))  # a killed command's
        self._known: dict[Path, tuple[int, int]] = {}
        self._said: tuple[Counts | None, float] = None, 0.0

    def __call__(self, counts: Counts) -> None:
        said, when = self._said
        if counts == said or (said and time.monotonic() - when < _SAY_S):
            return
        self._said = counts, time.monotonic()
        jobs = f"{counts.waiting} waiting, {counts.working} at work, {counts.ended} ended"
        progress.say(f"SLURM: {jobs}; {self._views()} views done")

    def _views(self) -> int:
        """How many views the parts hold; of those that did not change, what they held before."""
        import pandas as pd

        for path in self._parts.glob("*.parquet"):
            try:
                changed = path.stat().st_mtime_ns
                if path not in self._before and self._known.get(path, (0, 0))[0] != changed:
                    rows = pd.read_parquet(path, columns=["view", "metric"])
                    self._known[path] = changed, int((results.restoration_rows(rows)["view"] != "").sum())
            except (OSError, ValueError):  # replaced while it is read
                continue
        return sum(views for _, views in self._known.values())


# What became of a job, by its last state; "" when the queue does not list it.
WORDS = {
    "BOOT_FAIL": "its node did not start",
    "CANCELLED": "was cancelled",
    "COMPLETED": "ended without a result",
    "NODE_FAIL": "its node failed",
    "OUT_OF_MEMORY": "ran out of memory; give more with hydra.launcher.mem_gb=",
    "PREEMPTED": "had to make room for others",
    "TIMEOUT": "reached its time limit; give hydra.launcher.timeout_min= or more shards",
    "": "is not known to SLURM any more",
}


@dataclass(frozen=True)
class Submitted:
    """A job in the queue: its id, the file it leaves its result in, and its logs."""

    id: str
    result: Path
    stdout: Path
    stderr: Path


@dataclass(frozen=True)
class Counts:
    """How many jobs wait in the queue, are at work, and have ended."""

    waiting: int
    working: int
    ended: int


def wait(
    jobs: Sequence[Submitted],
    states: Callable[[], dict[str, str] | None],
    latency_s: float,
    tell: Callable[[Counts], None] = lambda counts: None,
    *,
    look_s: float = 1.0,
    ask_s: float = 30.0,
) -> Iterator[tuple[Submitted, str]]:
    """Yield each job as it ends, with what went wrong: nothing where it left a result that says so.

    states: the queue's word on every job it knows, None while it gives no answer, which says nothing about any job;
    latency_s: most seconds until a result is visible after its job has ended; tell: function that gets each answer;
    look_s: seconds between two looks for results; ask_s: most seconds between two questions to the queue. Controllers
    of large sites should not be asked more often. A job that the queue starts anew (after its node failed, say) is
    waited for again.
    """
    left = {job.id: job for job in jobs}
    known = _Known()
    started, asked = time.monotonic(), float("-inf")
    while left:
        seen = _files({job.result.parent for job in left.values()})
        for job in [job for job in left.values() if job.result in seen]:
            del left[job.id]
            yield job, _what_it_says(job)
        now = time.monotonic()
        if left and now - asked > min((now - started) / 10, ask_s):
            answer, asked = states(), now
            if answer is not None:
                for id_ in left:
                    known.note(id_, answer, now)
                waiting = sum(known.last[id_] == "PENDING" for id_ in left)
                tell(Counts(waiting, len(left) - waiting, len(jobs) - len(left)))
        for job in [job for job in left.values() if now - known.ended_at.get(job.id, now) > latency_s]:
            del left[job.id]
            yield job, _lost(job, known.last[job.id])
        if left:
            time.sleep(look_s)


@dataclass(frozen=True)
class _Known:
    """What the queue said of jobs, by their ids: the last state, and when they were first seen to have ended."""

    last: dict[str, str] = field(default_factory=dict)
    ended_at: dict[str, float] = field(default_factory=dict)

    def note(self, id_: str, answer: Mapping[str, str], now: float) -> None:
        """Note the answer about one job; one that the queue does not list any more is as it last ended."""
        before = self.last.get(id_, "")
        state = answer.get(id_, before if before in ENDED else "")
        self.last[id_] = state
        if state in ENDED or not state:
            self.ended_at.setdefault(id_, now)
        else:
            self.ended_at.pop(id_, None)


def _files(folders: set[Path]) -> set[Path]:
    """What is in the folders now: a listing, which a network file system answers from the server."""
    found: set[Path] = set()
    for folder in folders:
        try:
            found.update(Path(entry.path) for entry in os.scandir(folder))
        except OSError:
            continue
    return found


class _Words(pickle.Unpickler):
    """Reads what submitit's jobs leave, a pair of texts; anything that would run code is refused."""

    def find_class(self, module: str, name: str) -> None:
        raise pickle.UnpicklingError(f"holds {module}.{name}, not only text")


def _what_it_says(job: Submitted) -> str:
    try:
        outcome, said = _Words(io.BytesIO(job.result.read_bytes())).load()
    except Exception as fault:  # whatever an unreadable pickle raises
        return f"left a result that cannot be read ({type(fault).__name__}); log: {job.stderr}"
    if outcome == "success":
        return str(said or "")
    return f"failed, {_last_line(str(said)) or outcome}; log: {job.stderr}"


def _lost(job: Submitted, state: str) -> str:
    said = _last_line(_text(job.stderr)) if state in ("FAILED", "COMPLETED") else ""
    detail = ", ".join(filter(None, [state, said]))
    return f"{WORDS.get(state, 'was killed')}{f' ({detail})' if detail else ''}; log: {job.stderr}"


def _text(path: Path) -> str:
    try:
        return path.read_text(errors="replace")
    except OSError:
        return ""


def _last_line(text: str) -> str:
    return next((line.strip() for line in reversed(text.splitlines()) if line.strip()), "")[:160]
