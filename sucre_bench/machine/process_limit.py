"""The limit on processes and threads that `ulimit -u` or a container sets."""

import errno
import os
import resource
from contextlib import suppress
from pathlib import Path

from sucre_bench.machine.cores import usable_cores

_REMEDY = "end other programs, or allow more: `ulimit -u 4096`"
_MANY = 4096  # so many are never used up by one user's commands
_NEEDED, _NEEDED_A_CORE = 6, 3  # threads of a command: OpenBLAS interrupts and Arrow aborts a process without


def too_few_processes() -> str:
    """Return why this process cannot start the threads that the numerical libraries need; empty if it can."""
    most = _most()
    if most is None or most >= _MANY or os.getuid() == 0:  # no limit holds for root
        return ""
    needed, used = _NEEDED + _NEEDED_A_CORE * usable_cores(), _used()
    if most - used >= needed:
        return ""
    return f"ulimit -u: allows {most} processes and threads, and {used} run; a command needs {needed} more; {_REMEDY}"


def _used() -> int:
    """How many threads this user's processes have."""
    used = 0
    for place in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it has ended
            if place.stat().st_uid == os.getuid():
                used += len(os.listdir(place / "task"))  # noqa: PTH208 - names are all that is needed
    return used


def want_of_processes(fault: BaseException) -> str:
    """Return what a fault says if no process or thread could be started, and the remedy; "" for any other fault."""
    is_thread = isinstance(fault, RuntimeError) and "can't start new thread" in str(fault)
    is_process = isinstance(fault, OSError) and fault.errno == errno.EAGAIN and fault.filename is None
    if not (is_thread or is_process):
        return ""
    most = _most()
    allowed = f"`ulimit -u` allows {most}" if most else "the limit is reached"
    return (
        f"no more processes or threads can be started, {allowed}; allow more, `ulimit -u 4096`, or end other programs"
    )


def _most() -> int | None:
    """How many processes and threads this user may have; None if there is no limit."""
    limit = resource.getrlimit(resource.RLIMIT_NPROC)[0]
    return None if limit == resource.RLIM_INFINITY else limit
