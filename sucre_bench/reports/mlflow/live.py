"""Logs a command while it runs, in a process of its own: no view waits for mlflow or its server.

The process follows the parts of the score table that the jobs write, on this machine or elsewhere.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from functools import partial
from multiprocessing.connection import wait
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from typing import TYPE_CHECKING

from sucre_bench.errors import OutputError, SucreBenchError
from sucre_bench.machine import progress
from sucre_bench.machine.processes import Forked, call, can_fork
from sucre_bench.machine.provenance import absent
from sucre_bench.machine.text_formats import masked, now
from sucre_bench.reports.mlflow.store import (
    Note,
    default_experiment,
    default_uri,
    how_to_look,
    one_line_for,
)
from sucre_bench.results.rows import values_of
from sucre_bench.results.table import PARTS, read_part

if TYPE_CHECKING:
    from sucre_bench.engine.preflight import Planned
    from sucre_bench.jobs.job import Job
    from sucre_bench.reports.mlflow.runs import Runs

_EVERY_S = 1.0  # looks for new rows
_PAUSE_S = 20.0  # until mlflow is tried again after a fault
_END = -1  # in place of a job's number
_REMEDY = "`sucre-bench track` tries again"


class Live:
    """The runs of a command. When its block ends, those that are at work are marked as killed."""

    def __init__(self) -> None:
        self._child: Forked | None = None
        self._jobs: list[Job] = []

    def __enter__(self) -> Live:
        return self

    def __exit__(self, *_: object) -> None:
        if self._child:
            self._child.stop()

    def start(self, planned: Sequence[Planned]) -> None:
        """Begin to follow the jobs, if there is work, and mlflow is wanted and installed."""
        self._jobs = [plan.job for plan in planned]
        uri, experiment = _place(self._jobs[0])
        if not any(plan.todo for plan in planned) or uri == "off":
            return
        if not absent("mlflow") and can_fork():
            self._child = Forked(
                partial(_follow, _Follower(self._jobs[0].out, uri, experiment, planned))
            )

    def begins(self, job: Job) -> None:
        """Begin the run of a job."""
        if self._child:
            self._child.give(next(number for number, one in enumerate(self._jobs) if one is job))

    def end(self, job: Job) -> None:
        """Log what lacks at the end, and print how to see it; if that fails, print the reason in one line.

        job: any of the command.
        """
        uri, experiment = _place(job)
        if uri == "off" or absent("mlflow"):
            return
        if Note(job.out).is_logged(uri, experiment):
            return
        with progress.live():
            progress.say(f"mlflow   logging in {masked(uri)}; all results are written already")
            try:
                if self._child:
                    _wait_for(self._child)
                else:
                    call(partial(_log, job.out, uri, experiment), _REMEDY)
            except SucreBenchError as fault:
                progress.say(
                    f"mlflow: not logged ({fault.without_remedy}); the table has everything, {_REMEDY}"
                )
            else:
                progress.say(f"mlflow   {how_to_look(uri)}")


def _place(job: Job) -> tuple[str, str]:
    return job.tracking.uri or default_uri(job.out), job.tracking.experiment or default_experiment()


def _wait_for(child: Forked) -> None:
    """Let the process that followed a command log its end. Raises what it raises."""
    child.give(_END)
    while not child.has_ended:
        wait([child.messages], 0.1)
        child.receive()
        progress.show("tick")
    if child.fault:
        raise child.fault
    if child.how:
        raise OutputError(f"the process that logs died, {child.how}")


def _log(out: Path, uri: str, experiment: str, runs: Runs | None = None) -> int:
    """Log what lacks, without what mlflow prints of each run."""
    from sucre_bench.reports.mlflow.runs import log

    with Path(os.devnull).open("w") as nothing, redirect_stdout(nothing), redirect_stderr(nothing):
        return log(out, uri, experiment, runs)


class _Follower:
    """Logs the jobs of a command that have begun, and their rows.

    runs: None until mlflow has answered; begun: numbers of jobs.
    """

    def __init__(self, out: Path, uri: str, experiment: str, planned: Sequence[Planned]) -> None:
        self.place = (out, uri, experiment)
        self.runs: Runs | None = None
        self.begun = set[int]()
        self._planned = planned
        self._since = now()
        self._paused_until = 0.0

    def look(self) -> None:
        """Log the jobs that have begun, and new rows. Raises OutputError where mlflow fails."""
        if self.runs is None and time.monotonic() < self._paused_until:
            return
        try:
            with one_line_for(self.place[1]):
                self.runs = self.runs or self._start()
                for number in self.begun:
                    self.runs.begin(self._jobs[number])
                self._add_rows(self.runs)
        except Exception:
            self.runs = None
            self._paused_until = time.monotonic() + _PAUSE_S
            raise

    def _start(self) -> Runs:
        from sucre_bench.engine.preflight import base_row
        from sucre_bench.reports.mlflow.runs import Job, Runs

        runs = Runs(*self.place)
        self._jobs = [Job.of(base_row(plan.job)) for plan in self._planned]
        for job, plan in zip(self._jobs, self._planned, strict=True):
            runs.steps(job.dataset, [(task.base.scene, task.base.view) for task in plan.tasks])
        runs.start(self._jobs)
        todo = [{(task.base.scene, task.base.view) for task in plan.todo} for plan in self._planned]
        self._left = {job: views for job, views in zip(self._jobs, todo, strict=True) if views}
        self._read = set[Path]()
        return runs

    def _add_rows(self, runs: Runs) -> None:
        """Log the rows of new parts of the table, and end the jobs whose views are done."""
        from sucre_bench.reports.mlflow.runs import jobs_of

        folder = self.place[0] / PARTS
        for path in sorted(set(folder.glob("*.parquet")) - self._read if folder.is_dir() else ()):
            rows = read_part(path)
            rows = rows[rows["time"] >= self._since]
            self._read.add(path)
            runs.add(rows)
            for job, of_job in jobs_of(rows).items():
                if left := self._left.get(job):
                    left -= {*values_of(of_job, "scene", "view")}
                    if not left:
                        runs.close(job)


def _follow(follower: _Follower, send: Callable[..., None], take: Callable[[], int]) -> None:
    """Log a command until its end is asked for, and that too."""
    asked = SimpleQueue[int]()
    Thread(target=_pass_on, args=(take, asked), daemon=True).start()
    with Path(os.devnull).open("w") as nothing, redirect_stdout(nothing), redirect_stderr(nothing):
        try:
            while (number := _next(asked)) != _END:
                follower.begun |= {number} if number is not None else set()
                if asked.empty():
                    with suppress(SucreBenchError):  # the end tries again
                        follower.look()
            follower.look()
            _log(*follower.place, follower.runs)
        except KeyboardInterrupt:
            if follower.runs:
                follower.runs.kill()
            raise


def _next(asked: SimpleQueue[int]) -> int | None:
    try:
        return asked.get(timeout=_EVERY_S)
    except Empty:
        return None


def _pass_on(take: Callable[[], int], asked: SimpleQueue[int]) -> None:
    """Take what the command gives, so that it never waits."""
    with suppress(EOFError, OSError):
        while True:
            asked.put(take())
