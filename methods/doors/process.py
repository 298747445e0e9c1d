"""Runs a program without a shell and for a limited time, and ends all processes that it leaves behind.

The program gets no input, this process's environment and working folder, and a process group of its own. Of what it
prints, only the end is kept, however much it is. Its memory is sampled ten times a second: the resident memory of it
and all that it has started, in sum; pages they share count for each.
"""

import os
import selectors
import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import IO

import numpy as np

from sucre_bench.errors import InputError
from sucre_bench.machine.children import environment_of_programs
from sucre_bench.machine.sigterm import interrupts_held_back

_KEPT_BYTES = 16_384
_GRACE_S = 3.0
_SAMPLE_S = 0.1
_TICK_S = 0.01


@dataclass(frozen=True)
class Ended:
    """How a program ended. fault: empty when well, else why; said: the end of what it printed, errors last."""

    fault: str
    seconds: float
    peak_mb: float
    said: str

    @property
    def last_words(self) -> str:
        """The last line it printed, fit for a message."""
        lines = [line for line in self.said.splitlines() if line.strip()]
        return "".join(c if c.isprintable() else " " for c in lines[-1]).strip()[-200:] if lines else ""


def run_program(arguments: Sequence[str], timeout: float | None = None) -> Ended:
    """Run a program to its end, or for `timeout` seconds. InputError when it cannot be started.

    In every case (in time, too late or interrupted), the rest of its process group gets SIGTERM, and SIGKILL three
    seconds later.
    """
    started = time.perf_counter()
    watch = None
    try:
        with interrupts_held_back():
            watch = _Watch(_start(arguments))
        in_time = watch.until(None if timeout is None else started + timeout)
        seconds = time.perf_counter() - started
    finally:
        if watch:
            code = _ended(watch)
    fault = _fault(code) if in_time else f"was stopped after {timeout:g} s"
    return Ended(fault, seconds, watch.peak_mb, watch.said)


def _start(arguments: Sequence[str]) -> subprocess.Popen[bytes]:
    program = arguments[0]
    try:
        return subprocess.Popen(
            arguments,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            bufsize=0,
            env=environment_of_programs(),
            start_new_session=True,
        )
    except FileNotFoundError as fault:  # or what its first line names
        raise InputError(f"{program}: not found, or what runs it is not; install it or give its path") from fault
    except PermissionError as fault:
        raise InputError(f"{program}: may not be executed; chmod +x it, or name what runs it first") from fault
    except (OSError, ValueError) as fault:
        reason = getattr(fault, "strerror", None) or fault
        raise InputError(f"{program}: cannot be started, {reason}; name what runs it first, such as python3") from fault


def _ended(watch: "_Watch") -> int:
    """End a process with its group, take what it printed, and return its exit code. One more Ctrl-C kills the group."""
    with interrupts_held_back() as held, watch.process as process:
        # Before it is waited for: until then, its number cannot be another group's.
        _end(process.pid, watch.read, lambda: bool(held.numbers))
        watch.read()
        return process.wait()


def _end(group: int, meanwhile: Callable[[], None], is_urgent: Callable[[], bool]) -> None:
    """End a process group, asking first: a docker client then stops its container, which no kill would.

    All of it is waited for: the client may be the child of a script or of conda, which end at once.
    """
    _signal(group, signal.SIGTERM)
    deadline = time.perf_counter() + _GRACE_S
    while _is_alive(group) and time.perf_counter() < deadline and not is_urgent():
        meanwhile()
        time.sleep(_TICK_S)
    _signal(group, signal.SIGKILL)


def _signal(group: int, number: signal.Signals) -> None:
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(group, number)


def _is_alive(group: int) -> bool:
    """Whether any process of the group runs; those that have ended and are not waited for do not."""
    import psutil

    for pid in psutil.pids():
        with suppress(psutil.Error, ProcessLookupError, PermissionError):
            if os.getpgid(pid) == group and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE:
                return True
    return False


def _has_ended(process: subprocess.Popen[bytes]) -> bool:
    """Whether it ended; it is left to be waited for."""
    return os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


def _fault(code: int) -> str:
    if code >= 0:
        return f"ended with exit code {code}" if code else ""
    name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
    return f"was killed by {name}{', for want of memory perhaps' if -code == signal.SIGKILL else ''}"


@dataclass
class _Watch:
    """Reads what a running program prints, so that it never waits for us, and samples its memory."""

    process: subprocess.Popen[bytes]
    peak_mb: float = float("nan")
    _tails: dict[IO[bytes], bytearray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for stream in (self.process.stdout, self.process.stderr):
            assert stream is not None
            os.set_blocking(stream.fileno(), False)
            self._tails[stream] = bytearray()

    @property
    def said(self) -> str:
        return "\n".join(text for tail in self._tails.values() if (text := tail.decode(errors="replace").strip()))

    def until(self, deadline: float | None) -> bool:
        """Watch it to its end; False when the deadline passed before."""
        sample_at = time.perf_counter()
        with selectors.DefaultSelector() as selector:
            for stream in self._tails:
                selector.register(stream, selectors.EVENT_READ)
            while not _has_ended(self.process):
                now = time.perf_counter()
                if deadline is not None and now > deadline:
                    return False
                if now >= sample_at:
                    self._sample()
                    sample_at = time.perf_counter() + _SAMPLE_S
                for key, _ in selector.select(_TICK_S):
                    if not self._read(key.fileobj):  # type: ignore[arg-type]
                        selector.unregister(key.fileobj)
        return True

    def read(self) -> None:
        """Take what is in the pipes, once: a daemon that holds one open cannot keep us."""
        for stream in self._tails:
            self._read(stream)

    def _read(self, stream: IO[bytes]) -> bool:
        with suppress(BlockingIOError):
            chunk = os.read(stream.fileno(), 1 << 20)
            self._tails[stream] = (self._tails[stream] + chunk)[-_KEPT_BYTES:]
            return bool(chunk)
        return True

    def _sample(self) -> None:
        import psutil

        with suppress(psutil.Error):
            top = psutil.Process(self.process.pid)
            total = 0
            for one in (top, *top.children(recursive=True)):
                with suppress(psutil.Error):  # it ended in between
                    total += one.memory_info().rss
            self.peak_mb = float(np.fmax(self.peak_mb, total / 2**20))
