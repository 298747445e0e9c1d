"""Handles the signals that end a command: Ctrl-C, and SIGTERM in the same way."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

_STOPS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def terminated_as_interrupt() -> Iterator[None]:
    """Let SIGTERM end this block like Ctrl-C, so that finished work is kept and merged."""
    try:
        before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    except ValueError:  # not the main thread, which alone may set handlers
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@dataclass
class HeldBack:
    """The signals that came in a block of `interrupts_held_back`, in their order."""

    numbers: list[int] = field(default_factory=list)

    def hold(self, number: int, _: object) -> None:
        """Handle a signal."""
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
