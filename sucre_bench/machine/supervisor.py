"""Runs a command in a child of this process, which says what happened, and goes on, if the child dies.

The child is forked before anything is imported that starts threads, so it costs a millisecond.
"""

import ctypes
import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress

from sucre_bench.machine.current_step import Note, NoteFile, at_work
from sucre_bench.machine.memory_limit import limit_mb
from sucre_bench.machine.sigterm import stop_at_signals

_GRACE_S = 5  # for threads that a plugin has left behind
_STOPS = (signal.SIGINT, signal.SIGTERM)
_STOPPED = (*_STOPS, signal.SIGHUP, signal.SIGQUIT)
_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of prctl(2)
_TIGHT_MB = 16_000  # a limit that a run of large images may reach
_WANT_OF_MEMORY = (signal.SIGABRT, signal.SIGBUS, signal.SIGKILL, signal.SIGSEGV)  # libraries end so without memory


def supervised(work: Callable[[], int], say: Callable[[str], None]) -> int:
    """Run a command in a child and return its exit code.

    If the child dies at a step (`machine.current_step`), another goes on that leaves the step out. say: called with a
    line if nothing can go on. Where a child cannot be forked safely, the work is done here.
    """
    if not _may_fork():
        return work()
    deaths: dict[str, str] = {}
    start = ""
    while True:
        file = NoteFile.in_memory()
        try:
            child = _fork()
        except OSError:  # the limit on processes is reached
            return _unsupervised(work)
        if not child:
            return _in_child(work, file, deaths, start)
        status = _wait(child)
        note = file.read()
        file.close()
        if note.status is not None:
            return note.status
        if status < 0 and -status in _STOPPED:
            return 128 - status
        how = how_it_ended(status, note)
        _show_cursor()
        if not note.step or note.remedy or note.step in deaths:
            at, remedy = f" in {note.step}" if note.step else "", note.remedy or "repeat the command"
            say(f"the process died ({how}){at}; {remedy}")
            return 1
        deaths[note.step], start = how, note.start


def _unsupervised(work: Callable[[], int]) -> int:
    """Do the work in this process, which signals stop as they would a child."""
    stop_at_signals()
    return work()


def how_it_ended(status: int, note: Note) -> str:
    """Say how a process ended that did not end well. status: its exit code, or minus the signal's number."""
    if note.is_late:
        return f"after {note.limit_s:g} s, which view_timeout_s allows"
    if status >= 0:
        return f"exit code {status}"
    limit = limit_mb()
    is_tight = limit is not None and limit < _TIGHT_MB and -status in _WANT_OF_MEMORY
    hint = ", perhaps for want of memory" if -status == signal.SIGKILL or is_tight else ""
    return f"signal {-status}{hint}" + (f", of which ulimit -v allows {limit} MB" if is_tight else "")


def _may_fork() -> bool:
    """Whether this process has done nothing yet that a forked child could not go on with."""
    is_fresh = threading.active_count() == 1 and "numpy" not in sys.modules
    return is_fresh and sys.platform == "linux" and sys.gettrace() is None


_child = 0


def _fork() -> int:
    """Fork; Ctrl-C and SIGTERM for this process are passed on to the child. 0 in the child."""
    global _child
    _child = 0
    for number in _STOPS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _pass_on)
    _child = os.fork()
    return _child


def _pass_on(number: int, _: object) -> None:
    if _child:
        with suppress(ProcessLookupError):
            os.kill(_child, number)


def _wait(child: int) -> int:
    """Wait for the child; return its exit code, or minus the number of the signal that ended it."""
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _in_child(work: Callable[[], int], file: NoteFile, deaths: dict[str, str], start: str) -> int:
    """Do the work. Its exit code is noted at once: what happens as Python ends does not change it any more."""
    _die_with_parent()
    stop_at_signals()
    status = 1
    try:
        with at_work(file, deaths, start):
            status = work()
    finally:
        file.write(Note(status=status))
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(_GRACE_S)
    return status


def _die_with_parent() -> None:
    """Let a SIGKILL of the parent end this process too."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)


def _show_cursor() -> None:
    """Bars of progress hide the cursor; the process that drew them cannot bring it back any more."""
    if sys.stderr.isatty():
        sys.stderr.write("\x1b[?25h\n")
