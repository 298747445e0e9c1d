"""Processes: the signals that end them, and work in a process forked from this one.

A forked process begins with all that this one has imported and opened, after a few milliseconds. It leads a process
group of its own, and dies with its parent. Its progress and what it prints appear as if this process did the work.
"""

from __future__ import annotations

import ctypes
import io
import os
import pickle
import signal
import stat
import struct
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from multiprocessing import Pipe, get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from sucre_bench.errors import PluginError, one_line
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


def dying_with_parent(number: int = signal.SIGTERM) -> Callable[[], None] | None:
    """Return what a new process calls so that a signal ends it when its parent ends; None on other systems than Linux.

    The parent is the thread that made the process.
    """
    if sys.platform != "linux":
        return None
    prctl = ctypes.CDLL(None).prctl  # found before the fork
    return lambda: prctl(_DIE_WITH_PARENT, number)


_GRACE_S = 5.0  # for a child that is asked to stop: a program that it runs gets three of them
_HEAD = struct.Struct("!i")  # of a message of multiprocessing's pipes: its length
# of a message; text that a plugin writes into the pipe reads as a longer one
_MOST_BYTES = 1 << 28

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
    if sys.platform != "linux" or (jax and jax.backends_are_initialized()):
        return False
    return sys.gettrace() is None


class Forked:
    """A child process at work.

    work: is called in the child with two functions: `send("name", *values)` sends a message, `take()` waits for the
    next value that this process gives. faults: of steps that it must leave out. step, limit_s: where it is, "" between
    steps, and the seconds it may take there; has_ended: whether it will send no more; how: how it died, "" if it did
    not; result, fault: what `work` returned, or raised.
    """

    def __init__(
        self, work: Work, faults: Mapping[str, Exception] = MappingProxyType({})
    ) -> None:
        self.step, self.how, self.has_ended = "", "", False
        self.result: Any = None
        self.fault: BaseException | None = None
        self.limit_s: float | None = None
        self._started = 0.0
        self._stop_at = float("inf")
        self._lines: set[str] = set()  # of progress that are not finished
        self._received = bytearray()
        self.messages, sending = Pipe()
        dying = dying_with_parent(signal.SIGKILL)
        given = (work, faults, self.messages, sending, os.getpid(), dying)
        self._process = get_context("fork").Process(target=_work_in_child, args=given)
        with warnings.catch_warnings():
            # idle threads of BLAS count as threads
            warnings.simplefilter("ignore", DeprecationWarning)
            self._process.start()
        sending.close()
        # half a message must not hold this process
        os.set_blocking(self.messages.fileno(), False)

    @property
    def is_late(self) -> bool:
        """Whether its step takes longer than it may."""
        if self.has_ended or self.limit_s is None:
            return False
        return time.monotonic() - self._started > self.limit_s

    def give(self, value: object) -> None:
        """Give the child what it waits for with `take()`."""
        with suppress(OSError):  # it has died, which `receive` finds
            self.messages.send(value)

    def receive(self) -> list[tuple[Any, ...]]:
        """Take the messages that are there, and notice if the child has died; return those of the work's own."""
        if self.has_ended:
            return []
        # whatever it has started may hold its end of the pipe open
        is_dead = self._process.exitcode is not None
        is_closed = self._read()
        own = [message for message in self._messages() if self._is_own(*message)]
        if not self.has_ended and (is_dead or is_closed):
            self._process.join(1.0)
            code = self._process.exitcode or 0
            memory = ", perhaps for want of memory" if code == -signal.SIGKILL else ""
            self._end(f"exit code {code}" if code >= 0 else f"signal {-code}{memory}")
        return own

    def _read(self) -> bool:
        """Read what is there; return whether the child's end is closed."""
        try:
            while content := os.read(self.messages.fileno(), 1 << 20):
                self._received += content
        except BlockingIOError:
            return False
        except OSError:
            pass
        return True

    def _messages(self) -> Iterator[tuple[Any, ...]]:
        """Take the whole messages from what was read. A plugin may have written into the pipe."""
        try:
            while not self.has_ended and len(self._received) >= _HEAD.size:
                (size,) = _HEAD.unpack_from(self._received)
                if not 0 < size < _MOST_BYTES:
                    raise ValueError(f"{size} bytes long")
                end = _HEAD.size + size
                if len(self._received) < end:
                    return
                name, *values = pickle.loads(self._received[_HEAD.size : end])
                del self._received[:end]
                yield name, *values
        except Exception as fault:
            self._end(f"its messages cannot be read, {one_line(fault)[:80]}")

    def _is_own(self, name: str, *values: Any) -> bool:
        """Whether a message is one of the work's own; if not, do what it says."""
        if name == "step":
            self.step, self.limit_s = values
            self._started = time.monotonic()
        elif name == "progress":
            if values[0] in ("started", "finished"):
                self._lines ^= {values[1]}
            progress.show(*values)
        elif name == "printed":
            getattr(sys, values[0]).write(values[1])
        elif name in ("result", "fault"):
            setattr(self, name, values[0])
            self._end()
        else:
            return True
        return False

    def wait(self, remedy: str) -> Any:
        """Return what the work returns, when it ends. Its exceptions are raised here.

        Raises PluginError with the step and the remedy if the process dies.
        """
        while not self.has_ended:
            wait([self.messages], 0.1)
            self.receive()
            progress.show("tick")
        if self.fault:
            raise self.fault
        if self.how:
            raise PluginError(f"the process died ({self.how}) in {self.step}", remedy=remedy)
        return self.result

    def ask_to_stop(self) -> None:
        """Let the work end as at Ctrl-C."""
        self._stop_at = time.monotonic() + _GRACE_S
        self._process.terminate()

    def stop(self) -> list[tuple[Any, ...]]:
        """End the child and what it has started: SIGTERM, unless it has it, and SIGKILL 5 s later.

        At Ctrl-C in the meantime it gets SIGTERM once more. Return the work's messages that were not received yet.
        """
        messages = list[tuple[Any, ...]]()
        if not self.has_ended and self._stop_at == float("inf"):
            self.ask_to_stop()
        while not self.has_ended and time.monotonic() < self._stop_at:
            try:
                wait([self.messages], 0.02)
                messages += self.receive()
            except KeyboardInterrupt:
                self._process.terminate()
        self._end()
        return messages

    def _end(self, how: str = "") -> None:
        """Kill the child and what it has left running."""
        if self.has_ended:
            return
        self.has_ended = True
        self.how = how
        assert self._process.pid
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.kill()
        self._process.join()
        self.messages.close()
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
    work: Work,
    faults: Mapping[str, Exception],
    of_parent: Connection,
    messages: Connection,
    parent: int,
    die_with_parent: Callable[[], None],
) -> None:
    global _reporting
    lock, own = threading.Lock(), os.getpid()  # for what threads print

    def send(*message: object) -> None:
        if os.getpid() == own:  # else a plugin has forked this process
            with lock:
                messages.send(message)

    # what lives longer than this process must not hold it
    os.register_at_fork(after_in_child=messages.close)
    die_with_parent()
    try:
        if os.getppid() != parent:
            os._exit(1)
        of_parent.close()
        os.setpgid(0, 0)  # a terminal's Ctrl-C is for the parent
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        for number, name in ((1, "stdout"), (2, "stderr")):
            raw = io.BufferedWriter(_ToParent(send, number, name))
            setattr(
                sys,
                name,
                io.TextIOWrapper(raw, "utf-8", "backslashreplace", line_buffering=True),
            )
        _reporting = send, faults, str(Path.cwd()), ""
        with progress.watched_by(lambda *event: send("progress", *event)):
            result = work(send, messages.recv)
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


class _ToParent(io.RawIOBase):
    """Sends what is written to the parent, which may be drawing in the same terminal."""

    def __init__(self, send: Send, number: int, name: str) -> None:
        self._send, self._number, self._name = send, number, name
        self._own = os.getpid()

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._number

    def write(self, content: Any) -> int:
        if os.getpid() != self._own:
            return os.write(self._number, content)
        self._send("printed", self._name, bytes(content).decode("utf-8", "replace"))
        return len(content)
