"""Runs plugins in worker processes, one for each job: whatever a plugin does to its process ends with it.

A worker is forked from this process, which opened the data and has started no threads, and lives as long as its job. It
sends the rows of each view; this process writes them. If it dies, or is late at a step, the next worker goes on after
it, and gives that step's view or score a row with the reason.
"""

from __future__ import annotations

import importlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing.connection import wait
from typing import Protocol

from sucre_bench.errors import Death, DiedError, DiskFullError, PluginError, SucreBenchError
from sucre_bench.machine import progress
from sucre_bench.machine.forked import Forked, can_fork
from sucre_bench.results.rows import Row

_TICK_S = 0.1
# Nearly every worker needs these: imported before the fork, they cost CPU time once. They start no threads but those of
# OpenBLAS, which is made for forks.
_SHARED = ("cv2", "numba", "scipy.ndimage", "scipy.optimize", "scipy.sparse.csgraph", "scipy.spatial")

Emit = Callable[[Sequence[Row]], None]


class Work(Protocol):
    """What is to be done in a worker. Only `work` runs there, and goes on where the last call of `keep` left it.

    It may return while something is left, to go on in another worker.
    """

    @property
    def name(self) -> str: ...
    def begin(self) -> bool: ...
    def work(self, emit: Emit) -> None: ...
    def keep(self, rows: Sequence[Row]) -> None: ...
    def is_left(self) -> bool: ...
    def wait(self) -> None: ...
    def fail(self, fault: Exception) -> None: ...
    def end(self) -> None: ...


def run_works(works: Iterable[Work], n_workers: int) -> None:
    """Do works, each in a worker of its own, n_workers at a time; 0: in this process.

    An OutputError of a work is a line, and the others go on; DiskFullError is raised, for none could write.
    """
    if n_workers == 0 or not can_fork():
        for work in works:
            with _faults_as_lines(work):
                try:
                    is_left = work.begin()
                    while is_left:
                        work.work(work.keep)
                        is_left = work.is_left()
                finally:
                    work.end()
        return
    waiting, at_work = deque(works), list[_AtWork]()
    try:
        while waiting or at_work:
            while waiting and len(at_work) < n_workers:
                at_work.append(_AtWork(waiting.popleft()))
            for one in at_work:
                one.go_on()
            at_work = [one for one in at_work if one.worker]
            wait([one.worker.messages for one in at_work if one.worker], _TICK_S)
            progress.tick()
    finally:
        for one in at_work:
            if one.worker:
                one.worker.ask_to_stop()
        for one in at_work:
            one.stop()


@contextmanager
def _faults_as_lines(work: Work) -> Iterator[None]:
    """Make a line of an error that ends a work; a full disk ends all."""
    try:
        yield
    except DiskFullError:
        raise
    except SucreBenchError as fault:
        progress.say(f"failed  {work.name}: {fault}", is_fault=True)


class _AtWork:
    """A work that has begun, and its worker: None once there is nothing to do."""

    def __init__(self, work: Work) -> None:
        self.work = work
        self.worker: Forked | None = None
        self._faults: dict[str, Exception] = {}
        with _faults_as_lines(work):
            if work.begin():
                self._fork()

    def _fork(self) -> None:
        for package in _SHARED:
            with suppress(ImportError):
                importlib.import_module(package)
        self.worker = Forked(lambda send: self.work.work(lambda rows: send("rows", rows)), self._faults)

    def stop(self) -> None:
        """Stop the worker, and write the rows that are there."""
        with suppress(SucreBenchError):
            if self.worker:
                for message in self.worker.stop():
                    self.work.keep(message[1])
        self.worker = None
        with suppress(SucreBenchError):
            self.work.end()

    def go_on(self) -> None:
        """Take the worker's messages, and do what follows of them."""
        with _faults_as_lines(self.work):
            try:
                if self.worker:
                    self._serve(self.worker)
            except SucreBenchError:
                self.stop()
                raise

    def _serve(self, worker: Forked) -> None:
        while not worker.has_ended and worker.messages.poll():
            if rows := worker.receive():
                self.work.keep(rows[1])
        if not worker.has_ended and worker.is_late:
            step, limit_s = worker.step, worker.limit_s  # before it hears that it must stop
            for message in worker.stop():
                self.work.keep(message[1])
            fault = f"took longer than view_timeout_s={limit_s:g}; give it more time, or smaller images"
            self._go_on_after(step, PluginError(fault))
        elif not worker.has_ended:
            self.work.wait()
        elif worker.fault:
            raise worker.fault
        elif worker.how:
            self._go_on_after(worker.step, DiedError(str(Death(worker.how, worker.step or self.work.name))))
        elif self.work.is_left():
            self._fork()
        else:
            self.worker = None
            self.work.end()

    def _go_on_after(self, step: str, fault: Exception) -> None:
        """Let another worker go on after the step at which one has died, or was late."""
        if step in self._faults:
            self.work.fail(fault)
            self.stop()
            return
        self._faults[step] = fault
        self._fork()


class Alone:
    """Work that writes its own results, and gives no rows."""

    def __init__(self, name: str, work: Callable[[], None]) -> None:
        self.name, self._work = name, work

    def begin(self) -> bool:
        """Begin."""
        return True

    def work(self, _: Emit) -> None:
        """Do all of it."""
        self._work()

    def keep(self, rows: Sequence[Row]) -> None:
        """Never called."""

    def is_left(self) -> bool:
        """Return False."""
        return False

    def wait(self) -> None:
        """Nothing waits."""

    def fail(self, fault: Exception) -> None:
        """Print why it ended."""
        progress.say(f"failed  {self.name}: {fault}", is_fault=True)

    def end(self) -> None:
        """End."""
