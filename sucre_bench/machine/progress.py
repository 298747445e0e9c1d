"""Progress that any plugin may report, and the command line may show.

``for x in track(items, "pairing")`` costs nothing unless somebody is watching: the command line installs a
watcher, a library user or a test has none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from typing import Protocol, TypeVar

__all__ = ["Watcher", "is_watched", "line", "say", "track", "watched_by"]

T = TypeVar("T")


class Watcher(Protocol):
    """Shows progress: `started` begins a line of work, `advanced` moves it on, `finished` ends it; `said` is text."""

    def started(self, what: str, total: int | None) -> int: ...
    def advanced(self, line: int) -> None: ...
    def finished(self, line: int) -> None: ...
    def said(self, text: str) -> None: ...


_watcher: ContextVar[Watcher | None] = ContextVar("watcher", default=None)


@contextmanager
def watched_by(watcher: Watcher) -> Iterator[None]:
    """Show the progress of everything inside."""
    token = _watcher.set(watcher)
    try:
        yield
    finally:
        _watcher.reset(token)


def is_watched() -> bool:
    """Whether somebody is watching."""
    return _watcher.get() is not None


def say(text: str) -> None:
    """Tell whoever is watching, at once."""
    watcher = _watcher.get()
    if watcher is not None:
        watcher.said(text)


@contextmanager
def line(what: str, total: int | None) -> Iterator[Callable[[], None]]:
    """Show a line of work inside this block; call what it gives for each step that is done."""
    watcher = _watcher.get()
    if watcher is None:
        yield lambda: None
        return
    own = watcher.started(what, total)
    try:
        yield partial(watcher.advanced, own)
    finally:
        watcher.finished(own)


def track(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
    """Yield the items, reporting each one that is done. what: a word or two; total: when items has no len()."""
    with line(what, len(items) if isinstance(items, Sized) else total) as step:
        for item in items:
            yield item
            step()
