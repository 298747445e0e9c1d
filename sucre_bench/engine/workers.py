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
        self.worker: Forked | None = None
        self.is_one_of_several = False  # whether other workers will need the same packages
        self._faults: dict[str, Exception] = {}  # of steps at which workers died or were late

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

    def go_on(self, in_this_process: bool) -> bool:
        """Do what can be done now; return whether the work goes on. An error that ends it is a line."""
        try:
            if in_this_process:
                is_left = self.begin()
                while is_left:
                    self.work(self.keep)
                    is_left = self.is_left()
            elif self._serve():
                return True
            self.stop()
        except DiskFullError:
            raise
        except SucreBenchError as fault:
            progress.say(f"failed  {self.name}: {fault}", is_fault=True)
            with suppress(SucreBenchError):
                self.stop()
        return False

    def _serve(self) -> bool:
        """Begin, or take the worker's messages and do what follows of them; return whether there is more to do."""
        worker = self.worker
        if worker is None:
            return self.begin() and self._fork()
        while not worker.has_ended and worker.messages.poll():
            if rows := worker.receive():
                self.keep(rows[1])
        step, fault = worker.step, None  # before it hears that it must stop
        if not worker.has_ended and worker.is_late:
            text = f"took longer than view_timeout_s={worker.limit_s:g}; give it more time, or smaller images"
            fault = PluginError(text)
            self._stop_worker()
        elif not worker.has_ended:
            self.keep([])
            return True
        elif worker.fault:
            raise worker.fault
        elif worker.how:
            fault = DiedError(worker.how, step or self.name)
        if fault is None:
            return self.is_left() and self._fork()
        if step in self._faults:
            self.fail(fault)
            return False
        self._faults[step] = fault  # another worker goes on after the step
        return self._fork()

    def _fork(self) -> bool:
        if self.is_one_of_several:
            for package in _SHARED:
                with suppress(ImportError):
                    importlib.import_module(package)
            start_compiler()
        self.worker = Forked(lambda send: self.work(lambda rows: send("rows", rows)), self._faults)
        return True

    def _stop_worker(self) -> None:
        """Stop the worker, and keep the rows that are there."""
        for message in self.worker.stop() if self.worker else ():
            self.keep(message[1])

    def stop(self) -> None:
        """Stop the worker, and write all rows."""
        try:
            self._stop_worker()
        finally:
            self.worker = None
            self.end()


def run_works(works: Iterable[Work], n_workers: int) -> None:
    """Do works, each in a worker of its own, n_workers at a time; 0: in this process.

    An OutputError of a work is a line, and the others go on; DiskFullError is raised, for none could write.
    """
    waiting, at_work = deque(works), list[Work]()
    in_this_process = n_workers == 0 or not can_fork()
    for work in waiting:
        work.is_one_of_several = len(waiting) > 1
    try:
        while waiting or at_work:
            while waiting and len(at_work) < max(1, n_workers):
                at_work.append(waiting.popleft())
            at_work = [work for work in at_work if work.go_on(in_this_process)]
            if workers := [work.worker.messages for work in at_work if work.worker]:
                wait(workers, _TICK_S)
            progress.show("tick")
    finally:
        for work in at_work:
            if work.worker:
                work.worker.ask_to_stop()
        for work in at_work:
            with suppress(SucreBenchError):
                work.stop()
