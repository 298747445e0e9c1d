"""Progress that a plugin reports and the command line shows.

``for x in track(items, "pairing")`` costs nothing without a watcher. The command line installs one; a script or a test
has none.
"""

from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import partial
from typing import Protocol, TypeVar

T = TypeVar("T")


class Watcher(Protocol):
    """Shows progress: `started` begins a line, `advanced` moves it on, `finished` ends it, `said` prints text.

    `tick` draws anew what changes with time.
    """

    def started(self, what: str, total: int | None) -> int: ...
    def advanced(self, line: int) -> None: ...
    def finished(self, line: int) -> None: ...
    def said(self, text: str, is_fault: bool) -> None: ...
    def tick(self) -> None: ...


_watcher: ContextVar[Watcher | None] = ContextVar("watcher", default=None)


@contextmanager
def watched_by(watcher: Watcher) -> Iterator[None]:
    """Show the progress of the work in this block."""
    token = _watcher.set(watcher)
    try:
        yield
    finally:
        _watcher.reset(token)


@dataclass(frozen=True)
class _Through:
    """A watcher that shows what `change` makes of each text, and nothing for None."""

    inner: Watcher
    change: Callable[[str], str | None]

    def started(self, what: str, total: int | None) -> int:
        return self.inner.started(what, total)

    def advanced(self, line: int) -> None:
        self.inner.advanced(line)

    def finished(self, line: int) -> None:
        self.inner.finished(line)

    def said(self, text: str, is_fault: bool) -> None:
        if (changed := self.change(text)) is not None:
            self.inner.said(changed, is_fault)

    def tick(self) -> None:
        self.inner.tick()


@contextmanager
def said_through(change: Callable[[str], str | None]) -> Iterator[None]:
    """Inside, `say` prints what `change` makes of each text; nothing where it returns None."""
    watcher = _watcher.get()
    if watcher is None:
        yield
        return
    with watched_by(_Through(watcher, change)):
        yield


def is_watched() -> bool:
    """Whether progress is shown."""
    return _watcher.get() is not None


def say(text: str, is_fault: bool = False) -> None:
    """Print a line at once, if progress is shown. is_fault: it says that something failed; it is red."""
    watcher = _watcher.get()
    if watcher is not None:
        watcher.said(text, is_fault)


def tick() -> None:
    """Draw progress anew: whoever waits for another process calls this about ten times a second."""
    watcher = _watcher.get()
    if watcher is not None:
        watcher.tick()


@contextmanager
def line(what: str, total: int | None) -> Iterator[Callable[[], None]]:
    """Show a line of work during this block. Call the function it yields once for each step done."""
    watcher = _watcher.get()
    if watcher is None:
        yield lambda: None
        return
    number = watcher.started(what, total)
    try:
        yield partial(watcher.advanced, number)
    finally:
        watcher.finished(number)


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
