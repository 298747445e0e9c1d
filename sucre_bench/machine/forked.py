"""Work in a process forked from this one, which watches it, and goes on if it dies.

The child begins with all that this process has imported and opened, after a few milliseconds. It leads a process group
of its own, and dies with its parent. Its progress and what it prints appear as if this process did the work.
"""

from __future__ import annotations

import ctypes
import io
import os
import pickle
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn, TypeVar

from sucre_bench.errors import PluginError, one_line
from sucre_bench.machine import progress

T = TypeVar("T")
Send = Callable[..., None]

_GRACE_S = 5.0  # for a child that is asked to stop: a program that it runs gets three of them
_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of prctl(2)

# How a forked process reports its steps, the faults of those that it must leave out, its folder and its present step.
_reporting: tuple[Send, Mapping[str, Exception], str, str] | None = None


@contextmanager
def step(name: str, limit_s: float | None = None) -> Iterator[None]:
    """Report that this process is at a step, if it was forked. limit_s: most seconds that the step may take.

    If an earlier process has died or was late at the step of this name, its fault is raised instead. A forked process
    is in its own folder again afterwards. A step within another one suspends the other's limit.
    """
    global _reporting
    if _reporting is None:
        yield
        return
    send, faults, folder, outer = _reporting
    if name in faults:
        raise faults[name]
    send("step", name, limit_s)
    _reporting = send, faults, folder, name
    try:
        yield
    finally:
        with suppress(OSError):  # it is gone
            os.chdir(folder)
        _reporting = send, faults, folder, outer
        send("step", outer, None)


def can_fork() -> bool:
    """Whether a child of this process could go on with what it has: on Linux, without a debugger and JAX's threads."""
    jax = sys.modules.get("jax._src.xla_bridge")
    return sys.platform == "linux" and sys.gettrace() is None and not (jax and jax.backends_are_initialized())


class Forked:
    """A child process at work.

    work: is called in the child with a function that sends a message: `send("name", *values)`; faults: of steps that it
    must leave out. step, limit_s: where it is, "" between steps, and the seconds it may take there; has_ended: whether
    it will send no more; how: how it died, "" if it did not; result, fault: what `work` returned, or raised.
    """

    def __init__(self, work: Callable[[Send], Any], faults: Mapping[str, Exception] = MappingProxyType({})) -> None:
        self.step, self.how, self.has_ended = "", "", False
        self.result: Any = None
        self.fault: BaseException | None = None
        self.limit_s: float | None = None
        self._started, self._stop_at = 0.0, float("inf")
        self._lines: dict[int, Any] = {}  # of progress: how each goes on here
        self._status: int | None = None
        self.messages, sending = Pipe(duplex=False)
        parent, libc = os.getpid(), ctypes.CDLL(None)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # idle threads of BLAS count as threads
            self._pid = os.fork()
        if not self._pid:
            libc.prctl(_DIE_WITH_PARENT, signal.SIGKILL)
            if os.getppid() == parent:
                self.messages.close()
                _work_in_child(work, sending, faults)
            os._exit(1)
        sending.close()

    @property
    def is_late(self) -> bool:
        """Whether its step takes longer than it may."""
        return self.limit_s is not None and time.monotonic() - self._started > self.limit_s

    def receive(self) -> tuple[Any, ...] | None:
        """Take a message that is there; return it if it is one of the work's own."""
        try:
            name, *values = self.messages.recv()
        except (EOFError, OSError, pickle.UnpicklingError):
            self._wait(1.0)
            self._end("it closed the files of others" if self._status is None else _how(self._status))
            return None
        if name == "step":
            self.step, self.limit_s = values
            self._started = time.monotonic()
        elif name == "progress":
            self._show(*values)
        elif name == "printed":
            getattr(sys, values[0]).write(values[1])
        elif name in ("result", "fault"):
            setattr(self, name, values[0])
            self._end()
        else:
            return name, *values
        return None

    def ask_to_stop(self) -> None:
        """Let the work end as at Ctrl-C."""
        self._stop_at = time.monotonic() + _GRACE_S
        self._signal(signal.SIGTERM)

    def stop(self) -> list[tuple[Any, ...]]:
        """End the child and what it has started: SIGTERM, unless it has it, and SIGKILL 5 s later.

        At Ctrl-C in the meantime it gets SIGTERM once more. Return the work's messages that were not received yet.
        """
        messages: list[tuple[Any, ...]] = []
        if not self.has_ended and self._stop_at == float("inf"):
            self.ask_to_stop()
        while not self.has_ended and time.monotonic() < self._stop_at:
            try:
                if wait([self.messages], 0.02) and (message := self.receive()):
                    messages.append(message)
            except KeyboardInterrupt:
                self._signal(signal.SIGTERM)
        self._end()
        return messages

    def _end(self, how: str = "") -> None:
        """Kill the child and what it has left running."""
        if self.has_ended:
            return
        self.has_ended, self.how = True, how
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._pid, signal.SIGKILL)
        self._signal(signal.SIGKILL)
        self.messages.close()
        for line in self._lines.values():
            line.__exit__(None, None, None)
        if self._status is None:
            self._status = os.waitstatus_to_exitcode(os.waitpid(self._pid, 0)[1])

    def _show(self, name: str, *values: Any) -> None:
        """Show progress of the child as that of this process."""
        if name == "said":
            progress.say(*values)
        elif name == "started":
            number, what, total = values
            line = self._lines[number] = _Line(what, total)
            line.__enter__()
        elif name == "advanced":
            self._lines[values[0]].advance()
        else:
            self._lines.pop(values[0]).__exit__(None, None, None)

    def _signal(self, number: signal.Signals) -> None:
        if self._status is None:
            with suppress(ProcessLookupError):
                os.kill(self._pid, number)

    def _wait(self, seconds: float) -> None:
        """Wait for the child's end, for some seconds."""
        until = time.monotonic() + seconds
        while self._status is None:
            pid, status = os.waitpid(self._pid, os.WNOHANG)
            if pid:
                self._status = os.waitstatus_to_exitcode(status)
            elif time.monotonic() >= until:
                return
            else:
                time.sleep(0.01)


class _Line:
    """A line of progress that a child reports."""

    def __init__(self, what: str, total: int | None) -> None:
        self._line = progress.line(what, total)

    def __enter__(self) -> None:
        self.advance = self._line.__enter__()

    def __exit__(self, *fault: Any) -> None:
        self._line.__exit__(*fault)


def call(work: Callable[[], T], remedy: str) -> T:
    """Return what a function returns in a forked process; its exceptions are raised here.

    Raises PluginError with the step and the remedy if the process dies. Where none can be forked, the function is
    called here.
    """
    if not can_fork():
        return work()
    child = Forked(lambda _: work())
    try:
        while not child.has_ended:
            if wait([child.messages], 0.1):
                child.receive()
            progress.tick()
    finally:
        if not child.has_ended:
            child.stop()
    if child.fault:
        raise child.fault
    if child.how:
        raise PluginError(f"the process died ({child.how}) in {child.step}", remedy=remedy)
    result: T = child.result
    return result


def _how(status: int) -> str:
    """Say how a process ended that did not end well. status: its exit code, or minus the signal's number."""
    if status >= 0:
        return f"exit code {status}"
    return f"signal {-status}{', perhaps for want of memory' if -status == signal.SIGKILL else ''}"


def _work_in_child(work: Callable[[Send], Any], messages: Connection, faults: Mapping[str, Exception]) -> NoReturn:
    global _reporting
    lock = threading.Lock()  # for what threads print

    def send(*message: object) -> None:
        content = pickle.dumps(message)
        with lock:
            messages.send_bytes(content)

    try:
        os.setpgid(0, 0)  # a terminal's Ctrl-C is for the parent
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        sys.stdout, sys.stderr = (_stream(send, number) for number in (1, 2))
        _reporting = send, faults, str(Path.cwd()), ""
        with progress.watched_by(_Reports(send)):
            result = work(send)
        for stream in (sys.stdout, sys.stderr):
            with suppress(ValueError):  # a plugin has closed it
                stream.flush()
        send("result", result)
    except BaseException as fault:
        with suppress(BaseException):
            try:
                send("fault", fault)
            except Exception:  # it cannot be sent
                send("fault", PluginError(one_line(fault)))
    os._exit(0)


class _Reports:
    """A `progress.Watcher` that reports to the parent."""

    def __init__(self, send: Send) -> None:
        self._send, self._count = send, 0

    def started(self, what: str, total: int | None) -> int:
        self._count += 1
        self._send("progress", "started", self._count, what, total)
        return self._count

    def advanced(self, line: int) -> None:
        self._send("progress", "advanced", line)

    def finished(self, line: int) -> None:
        self._send("progress", "finished", line)

    def said(self, text: str, is_fault: bool) -> None:
        self._send("progress", "said", text, is_fault)

    def tick(self) -> None:
        pass


class _ToParent(io.RawIOBase):
    """Sends what is written to the parent, which may be drawing in the same terminal."""

    def __init__(self, send: Send, number: int) -> None:
        self._send, self._number = send, number

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._number

    def write(self, content: Any) -> int:
        self._send("printed", ("stdout", "stderr")[self._number - 1], bytes(content).decode("utf-8", "replace"))
        return len(content)


def _stream(send: Send, number: int) -> io.TextIOWrapper:
    raw = io.BufferedWriter(_ToParent(send, number))
    return io.TextIOWrapper(raw, "utf-8", "backslashreplace", line_buffering=True)
