"""Progress that work reports, and its display on stderr: bars with the time left in a terminal, plain lines elsewhere.

``for x in track(items, "pairing")`` costs nothing without a watcher. The command line installs one with `live`; a
script or a test has none.
"""

import itertools
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from typing import Any, TypeVar

from sucre_bench.machine import terminal

T = TypeVar("T")

# Called with an event and its values: "started" number what total, "advanced" number, "finished" number,
# "said" text is_fault, or "tick". The number names a line of progress, also among those of other processes.
Watcher = Callable[..., None]

_watcher: ContextVar[Watcher | None] = ContextVar("watcher", default=None)
_numbers = itertools.count()


@contextmanager
def watched_by(watcher: Watcher) -> Iterator[None]:
    """Show the progress of the work in this block."""
    token = _watcher.set(watcher)
    try:
        yield
    finally:
        _watcher.reset(token)


def is_watched() -> bool:
    """Whether progress is shown."""
    return _watcher.get() is not None


def show(event: str, *values: Any) -> None:
    """Pass an event to the watcher, if there is one."""
    if watcher := _watcher.get():
        watcher(event, *values)


def say(text: str, is_fault: bool = False) -> None:
    """Print a line at once, if progress is shown. is_fault: it says that something failed; it is red."""
    show("said", text, is_fault)


@contextmanager
def line(what: str, total: int | None) -> Iterator[Callable[[], None]]:
    """Show a line of work during this block. Call the function it yields once for each step done, from any thread."""
    watcher = _watcher.get()
    if watcher is None:
        yield lambda: None
        return
    number = f"{os.getpid()}-{next(_numbers)}"
    watcher("started", number, what, total)
    try:
        yield partial(watcher, "advanced", number)
    finally:
        watcher("finished", number)


def track(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
    """Yield the items, and report progress after each. Plugins use it for long loops; the command line shows it.

    - what: one or two words that name the work;
    - total: number of items, needed if items has no len().

    >>> list(track([1, 2, 3], "counting"))
    [1, 2, 3]
    """
    with line(what, len(items) if isinstance(items, Sized) else total) as step:
        for item in items:
            yield item
            step()


# -- display ---------------------------------------------------------------------------------------------

_PLAIN_S = 10.0  # between the lines of one work in a log
_WORTH_A_LINE_S = 1.0
_DRAWN_S = 0.1
# whose steps tell the time left; rich does not count the first, with its imports
_PACE_S = 3600.0


def duration(seconds: float) -> str:
    """Return seconds as text with its unit, two digits or so.

    >>> [duration(s) for s in (0.4, 59, 600, 5000, 200000)]
    ['1 s', '59 s', '10 min', '1 h 23 min', '55 h 33 min']
    """
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"


class _Display:
    """A watcher that draws rich's bars, those of inner work below those of outer work. Disabled bars become lines."""

    def __init__(self, bars: Any, meanwhile: Callable[[], None]) -> None:
        self._bars, self._meanwhile = bars, meanwhile
        self._drawn = 0.0
        self._tasks: dict[str, Any] = {}
        self._said: set[tuple[Any, ...]] = set()

    def __call__(self, event: str, *values: Any) -> None:
        now = time.monotonic()
        is_plain = self._bars.disable
        if event == "said":
            if values not in self._said:  # by another process, too
                terminal.say(values[0], "red" if values[1] else "")
            self._said.add(values)
        elif event == "started":
            number, what, total = values
            inner = "  " * len(self._tasks)
            self._bars.add_task(inner + what, total=total, left="", what=what, told=now)
            self._tasks[number] = self._bars.tasks[-1]
        elif event == "advanced":
            task = self._tasks[values[0]]
            self._bars.advance(task.id)
            left = f"about {duration(task.time_remaining)} left" if task.time_remaining else ""
            self._bars.update(task.id, left=left)
            if is_plain and task.total and now - task.fields["told"] > _PLAIN_S:
                self._bars.update(task.id, told=now)
                terminal.err.print(
                    f"{task.fields['what']}: {task.completed:.0f}/{task.total}{left and f', {left}'}"
                )
        elif event == "finished":
            task = self._tasks.pop(values[0])
            self._bars.remove_task(task.id)
            if is_plain and not self._tasks and (took := task.elapsed or 0.0) > _WORTH_A_LINE_S:
                terminal.err.print(
                    f"{task.fields['what']}: {task.completed:.0f} done in {took:.1f} s"
                )
        if now - self._drawn >= _DRAWN_S:  # no thread draws: this process forks others
            self._bars.refresh()
            self._drawn = now
            self._meanwhile()


@contextmanager
def live(plain: bool = False, meanwhile: Callable[[], None] = lambda: None) -> Iterator[None]:
    """Show the progress of this block, unless it is shown already: bars in a terminal, lines elsewhere.

    plain: lines everywhere; meanwhile: called now and then.
    """
    if is_watched():
        yield
        return
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        SpinnerColumn,
        TextColumn,
        TimeElapsedColumn,
    )

    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(bar_width=30),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
    )
    is_plain = plain or not sys.stderr.isatty() or terminal.err.is_dumb_terminal
    bars = Progress(
        *columns,
        console=terminal.err,
        auto_refresh=False,
        disable=is_plain,
        speed_estimate_period=_PACE_S,
    )
    with bars, watched_by(_Display(bars, meanwhile)):
        yield
