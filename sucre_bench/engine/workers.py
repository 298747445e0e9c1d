"""Divides the views of all jobs among worker processes: whatever a plugin does to its process ends with it.

A worker is forked from this process, which opened the data and has started no threads. It serves one job, as `job.py`
says, and asks for views until none is left. Its rows come here, and this process writes them. If it dies, or is late at
a step, another worker goes on: it gives that step's view or score a row with the reason.
"""

from __future__ import annotations

import importlib
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from multiprocessing.connection import wait
from typing import Any

from sucre_bench.engine.job import serve
from sucre_bench.engine.preflight import Planned, base_row, planned_again
from sucre_bench.engine.score import row_of_fault
from sucre_bench.errors import (
    DiedError,
    DiskFullError,
    OutputError,
    PluginError,
    SucreBenchError,
    raise_if_stop,
)
from sucre_bench.machine import progress
from sucre_bench.machine.compute import start_compiler
from sucre_bench.machine.processes import Forked, can_fork
from sucre_bench.machine.records import shorten_records
from sucre_bench.results.layout import file_name, log_path, restored_path
from sucre_bench.results.rows import Row
from sucre_bench.results.table import Part

_TICK_S = 0.1
_FLUSH_S = 0.3  # most seconds until rows are on the disk
_MOST_GIVEN = 1000  # views that a worker gets at once, so that a message fits into the pipe
# Nearly every worker needs these: if there are several, they are imported before the fork, and cost CPU time once. They
# start no threads but those of OpenBLAS, which is made for forks.
_SHARED = ("cv2", "scipy.ndimage", "scipy.optimize", "scipy.sparse.csgraph", "scipy.spatial")


def run_jobs(planned: Iterable[Planned], n_workers: int) -> None:
    """Restore and score the views of all jobs, n_workers at a time; 0: in this process.

    A free worker takes the next job. When all have begun, it helps the job with the most views left.
    An OutputError of a job is a line, and the others go on; DiskFullError is raised, for none could write.
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
                _run_here(job)
            return
        if n_views > 1 and (len(jobs) > 1 or n_workers > 1):
            _import_shared()
        _run_in_workers(jobs, n_workers)


def run_alone(name: str, function: Callable[[], None], n_workers: int) -> None:
    """Call a function that writes its own results, in a worker; if n_workers is 0, in this process.

    If it dies at a step, or is late there, it is called again without it. Raises DiskFullError.
    """
    faults: dict[str, Exception] = {}
    process: Forked | None = None
    try:
        if n_workers == 0 or not can_fork():
            function()
            return
        while True:
            process = Forked(lambda *_: function(), faults)
            while not (process.has_ended or process.is_late):
                wait([process.messages], _TICK_S)
                process.receive()
                progress.show("tick")
            step = process.step
            fault = _fault_of(process, name)
            process.stop()
            if fault is None:
                return
            if step in faults:
                raise fault
            faults[step] = fault
    except DiskFullError:
        raise
    except Exception as fault:
        progress.say(f"failed  {name}: {fault}", is_fault=True)
    finally:
        if process:
            process.stop()


def _fault_of(process: Forked, name: str) -> Exception | None:
    """Why a process is late or came to no good end. Raises its OutputError, and a request to stop."""
    fault = process.fault
    if isinstance(fault, OutputError):
        raise fault
    if fault:
        raise_if_stop(fault)
        return fault if isinstance(fault, Exception) else PluginError(str(fault))
    if process.is_late:
        limit = f"view_timeout_s={process.limit_s:g}"
        return PluginError(f"took longer than {limit}; give it more time, or smaller images")
    return DiedError(process.how, process.step or name) if process.how else None


def _import_shared() -> None:
    """Import what workers share. What fails here fails there, too, and has a row."""
    for package in _SHARED:
        with suppress(ImportError):
            importlib.import_module(package)
    with suppress(Exception):
        start_compiler()


class _Job:
    """A job in the process of the command, which gives its views out and writes their rows.

    left: groups of views that no worker has, as places in `planned.todo`, see `Planned.by_scene`; faults: of steps that
    workers leave out; n_ready: how many workers have made its method; is_full: whether no more can; is_given_up:
    whether its results cannot be written; after_view: called when a view is done.
    """

    def __init__(self, planned: Planned) -> None:
        self._plan(planned)
        self.faults: dict[str, Exception] = {}
        self.n_ready = 0
        self.is_full = self.is_given_up = False
        self.after_view: list[Callable[[], None]] = []
        job = planned.job
        self._part = Part(
            job.out, file_name(f"{job.dataset.label}-{job.method.label}"), _FLUSH_S
        )
        self._shown = ExitStack()

    def _plan(self, planned: Planned) -> None:
        self.planned = planned
        self.left = deque(self._groups(range(len(planned.todo))))

    def _groups(self, places: Iterable[int]) -> list[list[int]]:
        """Views to do, in the groups that a worker gets whole."""
        groups = defaultdict[Any, list[int]](list)
        for place in places:
            whole = self.planned.todo[place].base.scene if self.planned.by_scene else place
            groups[whole].append(place)
        return [*groups.values()]

    def begin(self) -> None:
        """Show the progress."""
        job, tasks = self.planned.job, self.planned.tasks
        if tasks and not tasks[0].base.code.startswith(base_row(job).code):
            # an earlier job has made files that it reads
            self._plan(planned_again(self.planned))
        n_views = len(self.planned.todo)
        line = progress.line(f"{job.method.label} on {job.dataset.label}", n_views)
        self.after_view.append(self._shown.enter_context(line))

    def take(self, n_workers: int) -> list[int]:
        """Take views for a worker: about half of its share of what is left, so that all end at the same time."""
        n_groups = (
            len(self.left) if n_workers < 2 else max(1, len(self.left) // (2 * n_workers))
        )
        taken: list[int] = []
        while n_groups and self.left and len(taken) < _MOST_GIVEN:
            taken += self.left.popleft()
            n_groups -= 1
        return taken

    def note(self, given: list[int], kind: str, *values: Any) -> None:
        """Do what a worker's message says. given: the views that it has; those that are done are removed."""
        if kind == "ready":
            self.n_ready += 1
        elif kind == "unfit" and self.n_ready:
            # for want of memory, say: the other workers do its share
            self.is_full = True
        elif kind == "unfit":
            (row,) = values
            if row.status == "failed":
                progress.say(f"failed  {self.planned.name}: {row.reason}", is_fault=True)
            while self.left:
                for place in self.left.popleft():
                    base = self.planned.todo[place].base
                    of_view = {"scene": base.scene, "view": base.view, "data_id": base.data_id}
                    self._keep([replace(row, code=base.code, **of_view)])
        elif kind == "rows" and values[0] in given:
            given.remove(values[0])
            self._keep(values[1])

    def fail(self, place: int, fault: Exception) -> None:
        """Give a view a row with the reason."""
        base = self.planned.todo[place].base
        self._keep([row_of_fault(base, fault, log_path(self.planned.job.out), is_said=True)])

    def _keep(self, rows: Sequence[Row]) -> None:
        self._part.add(rows)
        for done in self.after_view:
            done()

    def flush(self) -> None:
        """Write rows that have waited long enough."""
        self._part.add(())

    def give_back(self, places: list[int]) -> None:
        """Take back views that a worker had and did not do."""
        if not self.is_given_up:
            self.left.extendleft(reversed(self._groups(places)))
        places.clear()

    @contextmanager
    def giving_up(self) -> Iterator[None]:
        """If an OutputError ends this block, say it, and leave the views that are left. Raises DiskFullError."""
        try:
            yield
        except DiskFullError:
            raise
        except SucreBenchError as fault:
            if not self.is_given_up:
                progress.say(f"failed  {self.planned.name}: {fault}", is_fault=True)
            self.is_given_up = True
            self.left.clear()

    def end(self) -> None:
        """Write what is not written yet."""
        self._shown.close()
        self._part.flush()
        job = self.planned.job
        shorten_records(restored_path(job.out, file_name(job.dataset.label), job.method.label))


class _Worker:
    """A worker process of a job. given: the views that it has; leaves_out: the steps at which others died."""

    def __init__(self, job: _Job) -> None:
        self.job = job
        self.given = list[int]()
        self.leaves_out = frozenset(job.faults)
        self._is_ready = self._is_last = False
        self.process = Forked(partial(serve, job.planned), dict(job.faults))

    def go_on(self, n_workers: int) -> bool:
        """Do what follows of its messages; return whether it goes on. Raises OutputError."""
        job, process = self.job, self.process
        self._note(process.receive())
        if process.has_ended or process.is_late:
            step = process.step
            fault = _fault_of(process, job.planned.name)
            self._note(process.stop())
            job.n_ready -= self._is_ready
            if fault and step in self.leaves_out:
                if not self.given and job.left:
                    self.given += job.left.popleft()
                if self.given:
                    job.fail(self.given.pop(0), fault)
            if fault:
                job.faults[step] = fault
            job.give_back(self.given)
            return False
        if self._is_ready and not self.given and not self._is_last:
            self.given = job.take(n_workers)
            self._is_last = not self.given
            process.give(self.given.copy())
        return True

    def end(self) -> None:
        """Stop, and keep the rows that are there. Raises OutputError."""
        self._note(self.process.stop())

    def _note(self, messages: Iterable[tuple[Any, ...]]) -> None:
        for message in messages:
            self._is_ready |= message[0] == "ready"
            self.job.note(self.given, *message)


def _run_in_workers(jobs: Sequence[_Job], n_workers: int) -> None:
    workers, at_work = list[_Worker](), list[_Job]()
    try:
        while True:
            while len(workers) < n_workers and (next_job := _next(jobs, workers)):
                with next_job.giving_up():
                    if next_job not in at_work:
                        at_work.append(next_job)
                        next_job.begin()
                    if next_job.left:
                        workers.append(_Worker(next_job))
            if not workers:
                return
            wait([worker.process.messages for worker in workers], _TICK_S)
            for worker in tuple(workers):
                goes_on = False
                with worker.job.giving_up():
                    goes_on = worker.go_on(n_workers)
                if not goes_on or worker.job.is_given_up:
                    workers.remove(worker)
                    with worker.job.giving_up():
                        worker.end()
            for job in tuple(at_work):
                with job.giving_up():
                    job.flush()
                    if not job.left and all(worker.job is not job for worker in workers):
                        at_work.remove(job)
                        job.end()
            progress.show("tick")
    finally:
        for worker in workers:
            worker.process.ask_to_stop()
        for end in (*(worker.end for worker in workers), *(job.end for job in at_work)):
            with suppress(SucreBenchError):
                end()


def _next(jobs: Sequence[_Job], workers: Sequence[_Worker]) -> _Job | None:
    """The job that a free worker serves: the first one without a worker, else the one with the most views left."""
    served = {worker.job for worker in workers}
    waiting = [job for job in jobs if job.left]
    first = next((job for job in waiting if job not in served), None)
    may_be_helped = (job for job in waiting if job.n_ready and not job.is_full)
    return first or max(may_be_helped, key=lambda job: len(job.left), default=None)


def _run_here(job: _Job) -> None:
    given: list[int] = []

    def take() -> list[int]:
        given[:] = job.take(1)
        return given.copy()

    with job.giving_up():
        try:
            job.begin()
            while job.left:
                job.n_ready = 0
                serve(job.planned, partial(job.note, given), take)
                job.give_back(given)
        finally:
            job.end()
