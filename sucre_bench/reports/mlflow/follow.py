"""Logs a command while it runs, in a process of its own: no view waits for mlflow or its server.

The process follows the parts of the score table that the jobs write, on this machine or elsewhere.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any, NamedTuple

from sucre_bench.engine.preflight import Planned, base_row
from sucre_bench.errors import SucreBenchError
from sucre_bench.machine.text_formats import now
from sucre_bench.reports.mlflow.runs import JobKey, Runs, jobs_of, log
from sucre_bench.reports.mlflow.store import Place, prepare, reported
from sucre_bench.results.rows import Row, values_of
from sucre_bench.results.table import PARTS, read_part

_EVERY_S = 1.0  # looks for new rows
_PAUSE_S = 20.0  # until mlflow is tried again after a fault


class PlannedViews(NamedTuple):
    """A job, its views by scene and name, and those of them that are to be restored."""

    job: JobKey
    views: Collection[tuple[str, str]]
    todo: set[tuple[str, str]]

    @classmethod
    def of(cls, plan: Planned) -> PlannedViews:
        """Return what is logged of a job's plan."""
        views, todo = (
            [(task.base.scene, task.base.view) for task in tasks]
            for tasks in (plan.tasks, plan.todo)
        )
        return cls(JobKey.of(base_row(plan.job)), views, set(todo))


class Follower:
    """Logs the jobs of a command that have begun, and their rows.

    runs: None until mlflow has answered; send: gives the command the reason if mlflow fails.
    """

    def __init__(self, out: Path, place: Place, send: Callable[..., None]) -> None:
        self._out = out
        self._place = place
        self._send = send
        self.runs: Runs | None = None
        self._planned: Sequence[PlannedViews] | None = None
        self._begun = list[JobKey]()
        self._read = set[Path]()
        self._since = now()
        self._paused_until = 0.0

    def follow(self, planned: Sequence[PlannedViews]) -> None:
        """Take the jobs of the command."""
        self._planned = planned

    def begin(self, base: Row) -> None:
        """Take a job that begins. base: what each of its rows says."""
        self._begun.append(JobKey.of(base))

    def look(self) -> None:
        """Log the jobs that have begun, and new rows. If mlflow fails, try again later."""
        if self._planned is None or time.monotonic() < self._paused_until:
            return
        try:
            with reported(self._place.uri):
                self.runs = self.runs or self._start(self._planned)
                for job in self._begun:
                    self.runs.begin(job)
                self._add_rows(self.runs)
        except SucreBenchError as fault:
            self._paused_until = time.monotonic() + _PAUSE_S
            self._send("failed", fault.without_remedy)

    def _start(self, planned: Sequence[PlannedViews]) -> Runs:
        runs = Runs(self._out, self._place)
        for plan in planned:
            runs.steps(plan.job.dataset, plan.views)
        parent = runs.start([plan.job for plan in planned])
        _measure_machine(parent.id, self._place.uri)
        self._left = {plan.job: plan.todo for plan in planned}
        return runs

    def _add_rows(self, runs: Runs) -> None:
        """Log the rows of new parts of the table, and end the jobs whose views are done."""
        for path in sorted(set((self._out / PARTS).glob("*.parquet")) - self._read):
            rows = read_part(path)
            rows = rows[rows["time"] >= self._since]
            runs.add(rows)
            self._read.add(path)
            for job, of_job in jobs_of(rows).items():
                if left := self._left.get(job):
                    left -= {*values_of(of_job, "scene", "view")}
                    if not left:
                        runs.close(job)


def _measure_machine(run_id: str, uri: str) -> None:
    """Let mlflow log use of processors, memory and GPUs until a run ends, if its own variable asks for that."""
    import mlflow
    from mlflow.environment_variables import MLFLOW_ENABLE_SYSTEM_METRICS_LOGGING

    if MLFLOW_ENABLE_SYSTEM_METRICS_LOGGING.get():
        from mlflow.system_metrics.system_metrics_monitor import SystemMetricsMonitor

        mlflow.set_tracking_uri(uri)
        SystemMetricsMonitor(run_id, resume_logging=True).start()


def follow(out: Path, place: Place, send: Callable[..., None], take: Callable[[], Any]) -> None:
    """Log a command until its end is asked for, and that too."""
    news = SimpleQueue[Any]()
    Thread(target=_pass_on, args=(take, news), daemon=True).start()
    follower = Follower(out, place, send)
    with reported(place.uri):
        prepare(place)
        try:
            while True:
                with suppress(Empty):
                    given = news.get(timeout=_EVERY_S)
                    if given is None:
                        break
                    step, value = given
                    step(follower, value)
                if news.empty():
                    follower.look()
            log(out, place, follower.runs)
        except KeyboardInterrupt:
            if follower.runs:
                follower.runs.kill()
            raise


def _pass_on(take: Callable[[], Any], news: SimpleQueue[Any]) -> None:
    """Take what the command gives, so that it never waits."""
    with suppress(EOFError, OSError):
        while True:
            news.put(take())
