"""Handles the signals that end a command: Ctrl-C, and SIGTERM in the same way."""

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager

_REPEATED_S = 0.5
_last = -_REPEATED_S


def _is_repeated() -> bool:
    """Whether the same request was just served: a terminal, timeout(1) or a queue signals every process of a command,
    and our parent passes on what it gets.
    """
    global _last
    before, _last = _last, time.monotonic()
    return _last - before < _REPEATED_S


def _interrupt(*_: object) -> None:
    if not _is_repeated():
        raise KeyboardInterrupt


def _terminate(*_: object) -> None:
    if not _is_repeated():
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGTERM)


def stop_at_signals() -> None:
    """Let Ctrl-C interrupt this process and SIGTERM end it, once for signals that arrive together."""
    for number, handler in ((signal.SIGINT, _interrupt), (signal.SIGTERM, _terminate)):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handler)


@contextmanager
def terminated_as_interrupt() -> Iterator[None]:
    """Let SIGTERM end this block like Ctrl-C, so that finished work is kept and merged."""
    try:
        before = signal.signal(signal.SIGTERM, _interrupt)
    except ValueError:  # not the main thread, which alone may set handlers
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
