"""Divides the views of all jobs among worker processes: whatever a plugin does to its process ends with it.

A worker is forked from this process, which opened the data and has started no threads. It serves one job, as `job.py`
says, and asks for views until none is left. Its rows come here, and this process writes them. If it dies, or is late at
a step, another worker goes on: it gives that step's view or score a row with the reason.
"""

from __future__ import annotations

import importlib
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import partial
from itertools import chain
from multiprocessing.connection import wait
from typing import Any

from sucre_bench.engine.job import serve
from sucre_bench.engine.preflight import Planned, base_row, planned_again
from sucre_bench.engine.score import row_of_fault
from sucre_bench.errors import (
    DiskFullError,
    OutputError,
    PluginError,
    SucreBenchError,
)
from sucre_bench.machine import progress
from sucre_bench.machine.compute import start_compiler
from sucre_bench.machine.processes import Forked, can_fork
from sucre_bench.results.layout import file_name, log_path
from sucre_bench.results.rows import Row
from sucre_bench.results.table import Part

_TICK_S = 0.1
_FLUSH_S = 0.3  # most seconds until rows are on the disk
# Nearly every worker needs these: if there are several, they are imported before the fork, and cost CPU time once. They
# start no threads but those of OpenBLAS, which is made for forks.
_SHARED = ("cv2", "scipy.ndimage", "scipy.optimize", "scipy.sparse.csgraph", "scipy.spatial")


def run_jobs(planned: Iterable[Planned], n_workers: int) -> None:
    """Restore and score the views of all jobs, n_workers at a time; 0: in this process.

    A free worker takes the next job. When all have begun, it helps the job with the most views left.
    A job whose restorations cannot be written is a line, and the others go on. Raises OutputError if rows cannot be
    written, and DiskFullError.
    """
    jobs = [_Job(plan) for plan in planned if plan.todo]
    n_views = sum(len(job.planned.todo) for job in jobs)
    with ExitStack() as block:
        if len(jobs) > 1:
            after_view = block.enter_context(progress.line(f"{len(jobs)} jobs", n_views))
            for job in jobs:
                job.after_view.append(after_view)
        if n_workers == 0 or not can_fork():
            for job in jobs:
                job.run_here()
            return
        if n_views > 1 and (len(jobs) > 1 or n_workers > 1):
            _import_shared()
        _run_in_workers(jobs, n_workers)


def run_alone(name: str, function: Callable[[], None], n_workers: int) -> None:
    """Call a function that writes its own results, in a worker; if n_workers is 0, in this process.

    If it dies at a step, or is late there, it is called again without it. Raises DiskFullError.
    """
    try:
        if n_workers == 0 or not can_fork():
            function()
            return
        faults: dict[str, Exception] = {}
        while True:
            process = Forked(lambda *_: function(), faults)
            try:
                process.wait("mend the metric, or leave it out")
                return
            except PluginError as fault:
                if process.step in faults:
                    raise
                faults[process.step] = fault
            finally:
                process.stop()
    except DiskFullError:
        raise
    except Exception as fault:
        progress.say(f"failed  {name}: {fault}", is_fault=True)


def _import_shared() -> None:
    """Import what workers share. What fails here fails there, too, and has a row."""
    for package in _SHARED:
        with suppress(ImportError):
            importlib.import_module(package)
    with suppress(Exception):
        start_compiler()


class _Job:
    """A job in the process of the command, which gives its views out and writes their rows."""

    def __init__(self, planned: Planned) -> None:
        self.planned = planned
        self.left = _groups(planned)
        """Places in `planned.todo` of the views that no worker has, in groups that one worker does."""
        self.faults: dict[str, Exception] = {}
        """Of steps that workers leave out."""
        self.ready: set[_Worker] = set()
        """Workers that have made its method."""
        self.is_full = False
        """Whether no more workers can make it, for want of memory, say."""
        self.after_view: list[Callable[[], None]] = []
        """Called when a view is done."""
        self._has_begun = False
        self._line = ExitStack()
        job = planned.job
        self._part = Part(
            job.out, file_name(f"{job.dataset.label}-{job.method.label}"), _FLUSH_S
        )

    def begin(self) -> None:
        """Show the progress, if it has not begun."""
        if self._has_begun:
            return
        self._has_begun = True
        job = self.planned.job
        tasks = self.planned.tasks
        if tasks and not tasks[0].base.code.startswith(base_row(job).code):
            # an earlier job has made files that it reads
            self.planned = planned_again(self.planned)
            self.left = _groups(self.planned)
        name = f"{job.method.label} on {job.dataset.label}"
        line = progress.line(name, len(self.planned.todo))
        self.after_view.append(self._line.enter_context(line))

    def run_here(self) -> None:
        """Do all views in this process."""
        self.begin()
        try:
            while self.left:
                serve(self.planned, self.note, self.take)
        except OutputError as fault:
            self.give_up(fault)
        finally:
            self.end()

    def take(self) -> list[int]:
        """Take the next group of views; empty if none is left."""
        return self.left.popleft() if self.left else []

    def note(self, kind: str, *values: Any) -> None:
        """Do what a message of `serve` says."""
        if kind == "rows":
            self.keep(values[1])
        elif kind == "unfit" and self.ready:
            # the other workers do its share
            self.is_full = True
        elif kind == "unfit":
            (row,) = values
            if row.status == "failed":
                progress.say(f"failed  {self.planned.name}: {row.reason}", is_fault=True)
            for place in chain.from_iterable(self.left):
                base = self.planned.todo[place].base
                of_view = {"scene": base.scene, "view": base.view, "data_id": base.data_id}
                self.keep([replace(row, code=base.code, **of_view)])
            self.left.clear()

    def fail(self, place: int, fault: Exception) -> None:
        """Give a view a row with the reason."""
        base = self.planned.todo[place].base
        self.keep([row_of_fault(base, fault, log_path(self.planned.job.out), is_said=True)])

    def give_up(self, fault: OutputError) -> None:
        """Leave the views that are left: their restorations cannot be written. Raises DiskFullError."""
        if isinstance(fault, DiskFullError):
            # no other job could write either
            raise fault
        progress.say(f"failed  {self.planned.name}: {fault}", is_fault=True)
        self.left.clear()

    def keep(self, rows: Sequence[Row]) -> None:
        """Keep the rows of a view."""
        self._part.add(rows)
        for done in self.after_view:
            done()

    def flush(self) -> None:
        """Write rows that have waited long enough."""
        self._part.add(())

    def end(self) -> None:
        """Write what is not written yet."""
        self._line.close()
        self._part.flush()


def _groups(planned: Planned) -> deque[list[int]]:
    """The places of the views to do, in the groups that one worker does."""
    groups = defaultdict[Any, list[int]](list)
    for place, task in enumerate(planned.todo):
        groups[task.base.scene if planned.by_scene else place].append(place)
    return deque(groups.values())


class _Worker:
    """A worker process of a job."""

    def __init__(self, job: _Job) -> None:
        self.job = job
        self._places: list[int] = []  # of the views that it has
        job.begin()
        self.process = Forked(partial(serve, job.planned), job.faults)

    def go_on(self) -> bool:
        """Do what its messages say; return whether it goes on. Raises OutputError."""
        self._note(self.process.receive())
        if not self.process.has_ended:
            return True
        self.job.ready.discard(self)
        fault = self.process.fault
        if isinstance(fault, OutputError):
            self.job.give_up(fault)
            return False
        if isinstance(fault, Exception):
            self._blame(fault)
        elif fault:
            # SIGTERM for all processes of a job of SLURM, say
            raise fault
        if self._places:
            self.job.left.appendleft(self._places)
        return False

    def _blame(self, fault: Exception) -> None:
        """Let later workers leave out the step at which it ended; if it did leave that out, its view fails."""
        step = self.process.step
        if step not in self.process.faults:
            self.job.faults[step] = fault
            return
        self._places = self._places or self.job.take()
        if self._places:
            self.job.fail(self._places.pop(0), fault)

    def end(self) -> None:
        """Stop, and keep the rows that are there. Raises OutputError."""
        self._note(self.process.stop())

    def _note(self, messages: Iterable[tuple[Any, ...]]) -> None:
        for kind, *values in messages:
            if kind == "ready":
                self.job.ready.add(self)
                self._places = self.job.take()
                self.process.give(self._places)
            elif kind == "rows":
                self._places.remove(values[0])
            self.job.note(kind, *values)


def _run_in_workers(jobs: Sequence[_Job], n_workers: int) -> None:
    workers = list[_Worker]()
    try:
        while True:
            while len(workers) < n_workers and (next_job := _next(jobs, workers)):
                workers.append(_Worker(next_job))
            if not workers:
                return
            wait([source for worker in workers for source in worker.process.sources], _TICK_S)
            workers = [worker for worker in workers if worker.go_on()]
            served = {worker.job for worker in workers}
            for job in jobs:
                if job.left or job in served:
                    job.flush()
                else:
                    job.end()
            progress.show("tick")
    finally:
        for worker in workers:
            worker.process.ask_to_stop()
        for end in (*(worker.end for worker in workers), *(job.end for job in jobs)):
            with suppress(
                SucreBenchError, KeyboardInterrupt
            ):  # Ctrl-C again: without more waiting
                end()


def _next(jobs: Sequence[_Job], workers: Sequence[_Worker]) -> _Job | None:
    """The job that a free worker serves: the first one without a worker, else the one with the most views left."""
    served = {worker.job for worker in workers}
    waiting = [job for job in jobs if job.left]
    for job in waiting:
        if job not in served:
            return job
    may_be_helped = [job for job in waiting if job.ready and not job.is_full]
    return max(may_be_helped, key=lambda job: len(job.left), default=None)
