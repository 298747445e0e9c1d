"""Protects the process from plugins: a time limit for each step, and a check that outputs stay open."""

import builtins
import faulthandler
import io
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sucre_bench.errors import PluginError

_GRACE_S = 5.0  # for code that does not return to Python
_STREAMS = ("stdout", "stderr")


@contextmanager
def limited(limit_s: float | None) -> Iterator[None]:
    """Raise PluginError in this block after some seconds; if it cannot be raised, end the process 5 s later.

    A compiled function that does not return to Python lets no exception in. None: no limit. Outside the main thread
    there is none either.
    """
    if limit_s is None or threading.current_thread() is not threading.main_thread():
        yield
        return

    def time_is_up(*_: object) -> None:
        raise PluginError(f"took longer than view_timeout_s={limit_s:g}; give it more time, or smaller images")

    before = signal.signal(signal.SIGALRM, time_is_up)
    with Path(os.devnull).open("w") as nowhere:
        faulthandler.dump_traceback_later(limit_s + _GRACE_S, exit=True, file=nowhere)
        signal.setitimer(signal.ITIMER_REAL, limit_s)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            faulthandler.cancel_dump_traceback_later()
            signal.signal(signal.SIGALRM, before)


@contextmanager
def unharmed() -> Iterator[None]:
    """Restore what the block breaks for all that follows, and raise PluginError for it.

    This is: the standard output and error, Python's own functions, the working folder.
    """
    functions, folder = dict(vars(builtins)), os.open(".", os.O_RDONLY)
    streams = {name: getattr(sys, name) for name in _STREAMS}
    copies = {number: os.dup(number) for number in (1, 2) if _is_open(number)}
    try:
        yield
        now = vars(builtins)
        changed = [name for name, value in functions.items() if now.get(name) is not value and name != "_"]
        harm = [*_closed(streams, copies), *(f"changed builtins.{name}" for name in changed)]
    finally:
        vars(builtins).update(functions)
        for number, copy in copies.items():
            if not _is_open(number):
                os.dup2(copy, number)
            os.close(copy)
        for name, stream in streams.items():
            if stream is not None and stream.closed:
                stream = os.fdopen(os.dup(1 + _STREAMS.index(name)), "w", encoding="utf-8")
            setattr(sys, name, stream)
        os.fchdir(folder)  # where a plugin may have gone can be removed by now
        os.close(folder)
    if harm:
        raise PluginError(f"it {' and '.join(harm)}; a plugin must leave these alone")


def _is_open(number: int) -> bool:
    with suppress(OSError):
        os.fstat(number)
        return True
    return False


def _closed(streams: dict[str, io.TextIOBase], copies: dict[int, int]) -> list[str]:
    named = [name for name, stream in streams.items() if stream is not None and stream.closed]
    numbered = [_STREAMS[number - 1] for number in copies if not _is_open(number)]
    return [f"closed {name}" for name in dict.fromkeys([*named, *numbered])]
