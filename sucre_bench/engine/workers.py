"""Runs plugins in worker processes, one for each job: whatever a plugin does to its process ends with it.

A worker is forked from this process, which opened the data and has started no threads, and lives as long as its job. It
sends the rows of each view; this process writes them. If it dies, or is late at a step, the next worker goes on after
it. It gives that step's view or score a row with the reason.
"""

from __future__ import annotations

import importlib
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from multiprocessing.connection import wait

from sucre_bench.errors import DiedError, DiskFullError, PluginError, SucreBenchError
from sucre_bench.machine import progress
from sucre_bench.machine.compute import start_compiler
from sucre_bench.machine.processes import Forked, can_fork
from sucre_bench.results.rows import Row

_TICK_S = 0.1
# Nearly every worker needs these: if there are several, they are imported before the fork, and cost CPU time once. They
# start no threads but those of OpenBLAS, which is made for forks.
_SHARED = ("cv2", "scipy.ndimage", "scipy.optimize", "scipy.sparse.csgraph", "scipy.spatial")

Emit = Callable[[Sequence[Row]], None]


class Work:
    """What is to be done in a worker. This class is for a function that writes its own results, and gives no rows.

    Only `work` runs in the worker. It goes on where the last call of `keep` left it, and may return while something is
    left, to go on in another worker.
    """

    def __init__(self, name: str, function: Callable[[], None] = lambda: None) -> None:
        self.name, self._function = name, function

    def begin(self) -> bool:
        """Begin, and return whether there is anything to do."""
        return True

    def work(self, emit: Emit) -> None:
        """Do all of it, or a part. emit: called with the rows of each view."""
        self._function()

    def keep(self, rows: Sequence[Row]) -> None:
        """Keep the rows of the next view; without rows, write those that have waited."""

    def is_left(self) -> bool:
        """Whether there is more to do."""
        return False

    def fail(self, fault: Exception) -> None:
        """Give up, and say why."""
        progress.say(f"failed  {self.name}: {fault}", is_fault=True)

    def end(self) -> None:
        """Write what is not written yet."""


def run_works(works: Iterable[Work], n_workers: int) -> None:
    """Do works, each in a worker of its own, n_workers at a time; 0: in this process.

    An OutputError of a work is a line, and the others go on; DiskFullError is raised, for none could write.
    """
    waiting, at_work = deque(works), list[_AtWork]()
    in_this_process, are_several = n_workers == 0 or not can_fork(), len(waiting) > 1
    try:
        while waiting or at_work:
            while waiting and len(at_work) < max(1, n_workers):
                at_work.append(_AtWork(waiting.popleft(), are_several))
            at_work = [one for one in at_work if one.go_on(in_this_process)]
            if workers := [one.worker.messages for one in at_work if one.worker]:
                wait(workers, _TICK_S)
            progress.show("tick")
    finally:
        for one in at_work:
            if one.worker:
                one.worker.ask_to_stop()
        for one in at_work:
            with suppress(SucreBenchError):
                one.stop()


class _AtWork:
    """A work, and its worker if it has begun. is_one_of_several: whether other workers will need the same packages."""

    def __init__(self, work: Work, is_one_of_several: bool) -> None:
        self.work, self._is_one_of_several = work, is_one_of_several
        self.worker: Forked | None = None
        self._faults: dict[str, Exception] = {}

    def go_on(self, in_this_process: bool) -> bool:
        """Do what can be done now; return whether the work goes on. An error that ends it is a line."""
        try:
            if in_this_process:
                is_left = self.work.begin()
                while is_left:
                    self.work.work(self.work.keep)
                    is_left = self.work.is_left()
            elif self._serve():
                return True
            self.stop()
        except DiskFullError:
            raise
        except SucreBenchError as fault:
            progress.say(f"failed  {self.work.name}: {fault}", is_fault=True)
            with suppress(SucreBenchError):
                self.stop()
        return False

    def _serve(self) -> bool:
        """Begin, or take the worker's messages and do what follows of them; return whether there is more to do."""
        worker = self.worker
        if worker is None:
            return self.work.begin() and self._fork()
        while not worker.has_ended and worker.messages.poll():
            if rows := worker.receive():
                self.work.keep(rows[1])
        step, fault = worker.step, None  # before it hears that it must stop
        if not worker.has_ended and worker.is_late:
            text = f"took longer than view_timeout_s={worker.limit_s:g}; give it more time, or smaller images"
            fault = PluginError(text)
            self._stop_worker()
        elif not worker.has_ended:
            self.work.keep([])
            return True
        elif worker.fault:
            raise worker.fault
        elif worker.how:
            fault = DiedError(worker.how, step or self.work.name)
        if fault is None:
            return self.work.is_left() and self._fork()
        if step in self._faults:
            self.work.fail(fault)
            return False
        self._faults[step] = fault  # another worker goes on after the step
        return self._fork()

    def _fork(self) -> bool:
        if self._is_one_of_several:
            for package in _SHARED:
                with suppress(ImportError):
                    importlib.import_module(package)
            start_compiler()
        self.worker = Forked(lambda send: self.work.work(lambda rows: send("rows", rows)), self._faults)
        return True

    def _stop_worker(self) -> None:
        """Stop the worker, and keep the rows that are there."""
        for message in self.worker.stop() if self.worker else ():
            self.work.keep(message[1])

    def stop(self) -> None:
        """Stop the worker, and write all rows."""
        try:
            self._stop_worker()
        finally:
            self.worker = None
            self.work.end()
