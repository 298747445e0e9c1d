"""Processes: the signals that end them, and work in a process forked from this one.

A forked process begins with all that this one has imported and opened, after a few milliseconds. It leads a process
group of its own, and dies with its parent. Its progress and what it prints appear as if this process did the work.
"""

from __future__ import annotations

import ctypes
import io
import os
import signal
import socket
import stat
import struct
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from math import inf
from multiprocessing import Pipe, get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from sucre_bench.errors import DiedError, PluginError, SucreBenchError, one_line
from sucre_bench.machine import progress

T = TypeVar("T")
Send = Callable[..., None]
Work = Callable[[Send, Callable[[], Any]], Any]

# -- signals -----------------------------------------------------------------------------------------------


# What ends a command beside Ctrl-C: SIGHUP says that its terminal was closed, or the connection to it.
_ENDS = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))


@contextmanager
def _handled(stops: Iterable[int], handler: Callable[[int, object], None]) -> Iterator[None]:
    """Let a function handle signals in this block. Other threads than the main one may not set handlers, and need none:
    signals interrupt the main thread alone.
    """
    is_main = threading.current_thread() is threading.main_thread()
    before = {stop: signal.getsignal(stop) for stop in stops if is_main}
    try:
        for stop in before:
            signal.signal(stop, handler)
        yield
    finally:
        for stop, previous in before.items():
            signal.signal(stop, previous or signal.SIG_DFL)


@contextmanager
def terminated_as_interrupt() -> Iterator[None]:
    """Let SIGTERM and SIGHUP end this block like Ctrl-C, so that finished work is kept and merged.

    A signal that is ignored, as by `nohup`, stays so.
    """

    def interrupt(number: int, _: object) -> None:
        if number != signal.SIGTERM:
            for descriptor in (1, 2):
                with suppress(OSError):
                    if stat.S_ISCHR(os.fstat(descriptor).st_mode):
                        # writing to a closed terminal would fail
                        os.dup2(os.open(os.devnull, os.O_WRONLY), descriptor)
        raise KeyboardInterrupt

    heeded = [end for end in _ENDS if signal.getsignal(end) is not signal.SIG_IGN]
    with _handled(heeded, interrupt):
        yield


@contextmanager
def interrupts_held_back() -> Iterator[list[int]]:
    """Hold Ctrl-C, SIGTERM and SIGHUP back in this block, which must be short: they take effect at its end.

    Yields the list of the signals that came. So nothing that the block starts or creates is left without somebody who
    ends or removes it.
    """
    held: list[int] = []
    try:
        with _handled((signal.SIGINT, *_ENDS), lambda number, _: held.append(number)):
            yield held
    finally:
        for number in dict.fromkeys(held):
            signal.raise_signal(number)


# -- forked processes --------------------------------------------------------------------------------------

_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of prctl(2)
_TICK_S = 0.1
_GRACE_S = 5.0  # for a child that is asked to stop: a program that it runs gets three of them


def dying_with_parent(number: int = signal.SIGTERM) -> Callable[[], None] | None:
    """Return what a new process calls so that a signal ends it when its parent ends; None on other systems than Linux.

    The parent is the thread that made the process.
    """
    if sys.platform != "linux":
        return None
    prctl = ctypes.CDLL(None).prctl  # found before the fork
    return lambda: prctl(_DIE_WITH_PARENT, number)


_MOST_WAIT = struct.pack("@ll", 2, 0)  # for the rest of a message: seconds and microseconds

# This process's ends of the pipes to its children.
_our_ends = set[Connection]()

# In a forked process: what sends a message to its parent, and the faults of steps that it must leave out.
_send: Send | None = None
_faults: Mapping[str, Exception] = {}


@contextmanager
def step(name: str, limit_s: float | None = None) -> Iterator[None]:
    """Report that this process is at a step, if it was forked. limit_s: most seconds that the step may take.

    If an earlier process has died or was late at the step of this name, its fault is raised instead. A forked process
    is in its own folder again afterwards. The limit of a step ends when one begins within it.
    """
    if _send is None:
        yield
        return
    if name in _faults:
        raise _faults[name]
    folder = Path.cwd()
    _send("step", name, limit_s)
    try:
        yield
    finally:
        with suppress(OSError):  # it is gone
            os.chdir(folder)
        _send("step", name, None)


def can_fork() -> bool:
    """Whether a child of this process could go on with what it has: on Linux, without a debugger and JAX's threads."""
    jax = sys.modules.get("jax._src.xla_bridge")
    if sys.platform != "linux" or (jax and jax.backends_are_initialized()):
        return False
    return sys.gettrace() is None


class Forked:
    """A child process at work.

    work: is called in the child with two functions: `send("name", *values)` sends a message, `take()` waits for the
    next value that this process gives. faults: of steps that it must leave out.
    """

    def __init__(
        self, work: Work, faults: Mapping[str, Exception] = MappingProxyType({})
    ) -> None:
        self.faults = dict(faults)
        self.step = ""
        """Where it is, or was last."""
        self.has_ended = False
        self.result: Any = None
        """What `work` returned."""
        self.fault: BaseException | None = None
        """What `work` raised, or how it died or was late."""
        self._late_at = self._limit_s = inf
        self._is_asked = False
        self._lines: set[str] = set()  # of progress that are not finished
        self.messages, theirs = Pipe()
        _our_ends.add(self.messages)
        self._printed, printing = os.pipe()
        os.set_blocking(self._printed, False)
        self.sources: list[Any] = [self.messages, self._printed]
        """What `multiprocessing.connection.wait` waits for."""
        given = (work, self.faults, theirs, printing)
        self._process = get_context("fork").Process(target=_work_in_child, args=given)
        with warnings.catch_warnings():
            # idle threads of BLAS count as threads
            warnings.simplefilter("ignore", DeprecationWarning)
            self._process.start()
        theirs.close()
        os.close(printing)
        # text that a plugin has written into the pipe must not hold this process, as half a message would
        with socket.fromfd(self.messages.fileno(), socket.AF_UNIX, socket.SOCK_STREAM) as pipe:
            pipe.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _MOST_WAIT)

    def give(self, value: object) -> None:
        """Give the child what it waits for with `take()`."""
        with suppress(OSError):  # it has died, which `receive` finds
            self.messages.send(value)

    def receive(self) -> list[tuple[Any, ...]]:
        """Take the messages that are there, and end a child that is late; return those of the work's own."""
        own = self._received()
        if not self.has_ended and time.monotonic() > self._late_at:
            limit = f"view_timeout_s={self._limit_s:g}"
            own += self.stop()
            self.fault = PluginError(
                f"took longer than {limit}; give it more time, or smaller images"
            )
        return own

    def _received(self) -> list[tuple[Any, ...]]:
        # whatever it has started may hold its end of the pipe open
        is_dead = self._process.exitcode is not None
        own = list[tuple[Any, ...]]()
        self._show_printed()
        try:
            while not self.has_ended and self.messages.poll():
                name, *values = self.messages.recv()
                if name == "step":
                    self.step, limit_s = values
                    self._limit_s = limit_s or inf
                    self._late_at = time.monotonic() + self._limit_s
                elif name == "progress":
                    if values[0] in ("started", "finished"):
                        self._lines ^= {values[1]}
                    progress.show(*values)
                elif name == "ended":
                    self.result, self.fault = values
                    self._end()
                else:
                    own.append((name, *values))
        except Exception:  # it is closed, or has no message
            is_dead = True
        if is_dead and not self.has_ended:
            self._await_death(1.0)
            code = self._process.exitcode or 0
            memory = ", perhaps for want of memory" if code == -signal.SIGKILL else ""
            how = f"exit code {code}" if code >= 0 else f"signal {-code}{memory}"
            self.fault = DiedError(how, self.step)
            self._end()
        return own

    def _show_printed(self) -> None:
        with suppress(BlockingIOError):
            printed = os.read(self._printed, 1 << 16)
            sys.stderr.write(printed.decode("utf-8", "replace"))
            if not printed:
                self.sources = [self.messages]

    def wait(self, remedy: str) -> Any:
        """Return what the work returns, when it ends. Its exceptions are raised here.

        Raises PluginError with the step and the remedy if the process dies.
        """
        while not self.has_ended:
            wait(self.sources, _TICK_S)
            self.receive()
            progress.show("tick")
        if isinstance(self.fault, PluginError):
            raise PluginError(self.fault.fault, self.fault.place, remedy)
        if self.fault:
            raise self.fault
        return self.result

    def ask_to_stop(self) -> None:
        """Let the work end as at Ctrl-C."""
        if not self._is_asked:
            self._is_asked = True
            self._process.terminate()

    def stop(self) -> list[tuple[Any, ...]]:
        """End the child and what it has started: SIGTERM, unless it has it, and SIGKILL 5 s later.

        Return the work's messages that were not received yet.
        """
        if self.has_ended:
            return []
        self.ask_to_stop()
        try:
            self._await_death(_GRACE_S)
            return self._received()
        finally:
            self._end()

    def _await_death(self, most_s: float) -> None:
        """Wait until the child has died. Its `join` waits for ever if a plugin has written into its sentinel."""
        until = time.monotonic() + most_s
        while self._process.exitcode is None and time.monotonic() < until:
            time.sleep(0.01)

    def _end(self) -> None:
        """Kill the child and what it has left running."""
        if self.has_ended:
            return
        self.has_ended = True
        assert self._process.pid
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.kill()
        self._process.join()
        _our_ends.discard(self.messages)
        self.messages.close()
        self._show_printed()
        os.close(self._printed)
        for number in self._lines:
            progress.show("finished", number)


def call(work: Callable[[], T], remedy: str) -> T:
    """Return what a function returns in a forked process; its exceptions are raised here.

    Raises PluginError with the step and the remedy if the process dies. Where none can be forked, the function is
    called here.
    """
    if not can_fork():
        return work()
    child = Forked(lambda *_: work())
    try:
        result: T = child.wait(remedy)
        return result
    finally:
        child.stop()


def _work_in_child(
    work: Work, faults: Mapping[str, Exception], messages: Connection, printing: int
) -> None:
    global _send, _faults
    lock = threading.Lock()  # threads report progress, too
    own = os.getpid()

    def send(*message: object) -> None:
        if os.getpid() == own:  # else a plugin has forked this process
            with lock:
                messages.send(message)

    _send = send
    _faults = faults
    # what a plugin writes into every file must not reach the other children
    for end in _our_ends:
        end.close()
    # what lives longer than this process must not hold it
    os.register_at_fork(after_in_child=messages.close)
    if die := dying_with_parent(signal.SIGKILL):
        die()
    os.setpgid(0, 0)  # a terminal's Ctrl-C is for the parent
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    # the parent may be drawing in the same terminal
    os.dup2(printing, 1)
    os.dup2(printing, 2)
    sys.stdout = sys.stderr = io.TextIOWrapper(
        io.FileIO(2, "w", closefd=False), "utf-8", "backslashreplace", write_through=True
    )
    result: Any = None
    fault: BaseException | None = None
    try:
        with progress.watched_by(lambda *event: send("progress", *event)):
            result = work(send, messages.recv)
    except (SucreBenchError, KeyboardInterrupt) as raised:
        fault = raised
    except BaseException as raised:
        fault = PluginError(one_line(raised))
    with suppress(BaseException):
        send("ended", result, fault)
    os._exit(0)
