"""Runs a program without a shell and for a limited time, and ends all processes that it leaves behind.

The program gets no input, this process's environment and working folder, and a process group of its own. Of what it
prints, only the end is kept. Its memory is sampled ten times a second: the sum of the resident memory of the program
and of all that it has started.
"""

import os
import signal
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import inf, nan
from threading import Thread
from typing import IO

from sucre_bench.errors import InputError
from sucre_bench.machine.processes import environment_of_programs, interrupts_held_back

_KEPT_BYTES = 16_384
_GRACE_S = 3.0
_SAMPLE_S = 0.1
_LATE_OUTPUT_S = 0.5  # after its end: a daemon may hold the pipes open for ever


class Printed(Exception):  # noqa: N818, it is no error: it is kept with the traceback of one
    """What a program printed."""


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
    process, in_time, peak_mb = None, False, 0.0
    started = time.perf_counter()
    limit = started + (inf if timeout is None else timeout)
    tails = bytearray(), bytearray()
    try:
        with interrupts_held_back():
            process = _start(arguments)
            streams = zip((process.stdout, process.stderr), tails, strict=True)
            readers = [Thread(target=_keep_end, args=stream, daemon=True) for stream in streams]
            for reader in readers:
                reader.start()
        while not in_time and (left := limit - time.perf_counter()) > 0:
            peak_mb = max(peak_mb, _memory_mb(process.pid))
            with suppress(subprocess.TimeoutExpired):
                process.wait(min(_SAMPLE_S, left))
                in_time = True
        seconds = time.perf_counter() - started
    finally:
        if process:
            _end_group(process)
    for reader in readers:
        reader.join(_LATE_OUTPUT_S)
    code = process.returncode
    fault = f"ended with exit code {code}" if code else ""
    if not in_time:
        fault = f"was stopped after {timeout:g} s"
    elif code < 0:
        name = signal.Signals(-code).name if -code in set(signal.Signals) else f"signal {-code}"
        fault = f"was killed by {name}{', for want of memory perhaps' if -code == signal.SIGKILL else ''}"
    said = "\n".join(text for tail in tails if (text := tail.decode(errors="replace").strip()))
    return Ended(fault, seconds, peak_mb or nan, said)


def _start(arguments: Sequence[str]) -> subprocess.Popen[bytes]:
    try:
        return subprocess.Popen(
            arguments,
            bufsize=0,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=environment_of_programs(),
            start_new_session=True,
        )
    except (OSError, ValueError) as fault:  # of the program, or of what its first line names
        reason = getattr(fault, "strerror", None) or fault
        remedy = "install it, make it executable with chmod +x, or name what runs it first, such as python3"
        raise InputError(f"{arguments[0]}: cannot be started, {reason}; {remedy}") from fault


def _keep_end(stream: IO[bytes], tail: bytearray) -> None:
    with stream:
        while chunk := stream.read(1 << 16):
            tail += chunk
            del tail[:-_KEPT_BYTES]


def _memory_mb(pid: int) -> float:
    """The resident memory of a process and all that it has started, MB; 0 once it has ended."""
    import psutil

    total = 0.0
    with suppress(psutil.Error):
        top = psutil.Process(pid)
        for process in (top, *top.children(recursive=True)):
            with suppress(psutil.Error):  # it ended in between
                total += process.memory_info().rss / 2**20
    return total


def _end_group(process: subprocess.Popen[bytes]) -> None:
    """End a process and its group, asking first: a docker client then stops its container, which no kill would.

    The whole group gets the time: the client may be the child of a script or of conda, which end at once. One more
    Ctrl-C kills the group.
    """
    with interrupts_held_back() as held:
        with suppress(ProcessLookupError, PermissionError):  # a group that has ended, or is another user's
            os.killpg(process.pid, signal.SIGTERM)
            deadline = time.perf_counter() + _GRACE_S
            while _is_alive(process.pid) and time.perf_counter() < deadline and not held:
                time.sleep(0.01)
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _is_alive(group: int) -> bool:
    """Whether any process of the group runs; those that have ended and are not waited for do not."""
    import psutil

    for pid in psutil.pids():
        with suppress(psutil.Error, ProcessLookupError, PermissionError):
            if os.getpgid(pid) == group and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE:
                return True
    return False
