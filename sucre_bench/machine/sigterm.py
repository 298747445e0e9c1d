"""Handles the signals that end a command: Ctrl-C, and SIGTERM in the same way."""

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

_STOPS = (signal.SIGINT, signal.SIGTERM)
_REPEATED_S = 0.5
_last = -_REPEATED_S
_was_interrupted = False


def _is_repeated() -> bool:
    """Whether the same request was just served: a terminal, timeout(1) or a queue signals every process of a command,
    and our parent passes on what it gets.
    """
    global _last
    is_repeated = _was_just_served()
    _last = time.monotonic()
    return is_repeated


def _was_just_served() -> bool:
    return time.monotonic() - _last < _REPEATED_S


def was_interrupted() -> bool:
    """Whether Ctrl-C came at any time: an import that it interrupts may raise any error."""
    return _was_interrupted


def _interrupt(*_: object) -> None:
    global _was_interrupted
    _was_interrupted = True
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


@dataclass
class HeldBack:
    """The signals that came in a block of `interrupts_held_back`, in their order, without repetitions of one before."""

    numbers: list[int] = field(default_factory=list)

    def hold(self, number: int, _: object) -> None:
        """Handle a signal."""
        if not _was_just_served():
            self.numbers.append(number)


@contextmanager
def interrupts_held_back() -> Iterator[HeldBack]:
    """Hold Ctrl-C and SIGTERM back in this block, which must be short: they take effect at its end.

    So nothing that the block starts or creates is left without somebody who ends or removes it.
    """
    held = HeldBack()
    if threading.current_thread() is not threading.main_thread():  # signals interrupt the main thread alone
        yield held
        return
    before = {stop: handler for stop in _STOPS if (handler := signal.getsignal(stop)) is not None}
    for stop in before:
        signal.signal(stop, held.hold)
    try:
        yield held
    finally:
        for stop, handler in before.items():
            signal.signal(stop, handler)
        for number in dict.fromkeys(held.numbers):
            signal.raise_signal(number)
