"""Logs a command while it runs, in a process of its own: no view waits for mlflow or its server.

The process follows the parts of the score table that the jobs write, on this machine or elsewhere.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

from sucre_bench.engine.preflight import Planned, base_row
from sucre_bench.errors import SucreBenchError
from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress
from sucre_bench.machine.processes import Forked, call, can_fork
from sucre_bench.machine.text_formats import masked, now
from sucre_bench.reports.mlflow.runs import JobKey, Runs, jobs_of, log
from sucre_bench.reports.mlflow.store import Place, reported
from sucre_bench.results.rows import values_of
from sucre_bench.results.table import PARTS, read_part

_EVERY_S = 1.0  # looks for new rows
_PAUSE_S = 20.0  # until mlflow is tried again after a fault


class Live:
    """The runs of a command, of which job is one. When its block ends, those that are at work are marked as killed."""

    def __init__(self, job: Job) -> None:
        self._place = Place.of(job.out, job.tracking.uri, job.tracking.experiment)
        self._out = job.out
        self._has_work = True
        self._has_failed = False
        self._is_done = multiprocessing.Event()
        self._child: Forked | None = None

    def __enter__(self) -> Live:
        return self

    def __exit__(self, *_: object) -> None:
        if self._child:
            self._child.stop()

    def follow(self, planned: Sequence[Planned]) -> None:
        """Begin to follow the jobs, if there is work. planned: empty if another sweeper chooses the jobs."""
        self._has_work = not planned or any(plan.todo for plan in planned)
        if self._has_work and can_fork():
            work = partial(_follow, self._out, self._place, planned, self._is_done)
            self._child = Forked(work)

    def receive(self) -> None:
        """Print it once if mlflow fails."""
        for _, fault in self._child.receive() if self._child else ():
            if not self._has_failed:
                progress.say(f"mlflow: {fault}; the run goes on, and its end tries again")
            self._has_failed = True

    def end(self) -> None:
        """Log what lacks at the end, and print how to see it; if that fails, print the reason in one line."""
        if not self._has_work:
            return
        out, place = self._out, self._place
        remedy = f"`sucre-bench track {out}` tries again"
        with progress.live():
            progress.say(
                f"mlflow   logging in {masked(place.uri)}; all results are written already"
            )
            try:
                if self._child:
                    self._is_done.set()
                    self._child.wait(remedy)
                else:
                    call(partial(log, out, place), remedy)
            except SucreBenchError as fault:
                reason = "" if self._has_failed else f" ({fault.without_remedy})"
                progress.say(f"mlflow: not logged{reason}; the table has everything, {remedy}")
            else:
                progress.say(f"mlflow   {place.how_to_look}")


def _follow(
    out: Path,
    place: Place,
    planned: Sequence[Planned],
    is_done: Event,
    send: Callable[..., None],
    _: Callable[[], Any],
) -> None:
    """Log the rows of a command as they come until it is done, and then what lacks."""
    runs: Runs | None = None
    since = now()
    read = set[Path]()
    views = {
        JobKey.of(base_row(plan.job)): [(task.base.scene, task.base.view) for task in plan.todo]
        for plan in planned
    }
    left = {job: set(todo) for job, todo in views.items()}
    pause_s = 0.0
    try:
        while not is_done.wait(pause_s):
            pause_s = _EVERY_S
            try:
                with reported(place.uri):
                    if runs is None:
                        runs = Runs(out, place)
                        for plan in planned:
                            runs.steps(
                                plan.job.dataset.label,
                                [(task.base.scene, task.base.view) for task in plan.tasks],
                            )
                        runs.start()
                    for path in sorted({*(out / PARTS).glob("*.parquet")} - read):
                        rows = read_part(path)
                        rows = rows[rows["time"] >= since]
                        runs.add(rows)
                        read.add(path)
                        for job, of_job in jobs_of(rows).items():
                            if job in left:
                                left[job] -= {*values_of(of_job, "scene", "view")}
                                if not left[job]:
                                    runs.close(job)
            except SucreBenchError as fault:
                send("failed", fault.without_remedy)
                pause_s = _PAUSE_S
        log(out, place, runs)
    except KeyboardInterrupt:
        if runs:
            runs.kill()
        raise
