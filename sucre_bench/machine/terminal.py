"""Shows progress: bars with an estimate in a terminal, plain lines in a pipe or a log.

NO_COLOR removes colours. TERM=dumb or a pipe removes every escape code. FORCE_COLOR brings colours, but no bars, to a
pipe, such as the log of a CI.
"""

import sys
import time
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import IO

from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn
from rich.segment import Segment
from rich.table import Table

from sucre_bench.machine import progress
from sucre_bench.machine.pace import Pace, duration
from sucre_bench.machine.shown import shown

_PLAIN_SECONDS = 10.0
_WORTH_A_LINE = 1.0


class _Console(Console):
    """A console that writes out control characters of names and texts; styles are its own."""

    @property
    def file(self) -> IO[str]:
        """The terminal itself: below the streams that write out control characters, and rich's own while it draws."""
        file = super().file
        while (inner := getattr(file, "rich_proxied_file", None)) is not None:
            file = inner
        return file

    @file.setter
    def file(self, new_file: IO[str]) -> None:
        self._file = new_file

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else shown(text), style, control)


out = _Console(highlight=False, soft_wrap=not sys.stdout.isatty())
err = _Console(stderr=True, highlight=False, soft_wrap=not sys.stderr.isatty())


class _Bars:
    """A `progress.Watcher` that draws bars. Inner work stands below outer work, and is removed when it is done."""

    def __init__(self, bars: Progress) -> None:
        self._bars = bars
        self._depth = 0
        self._paces: dict[int, Pace] = {}

    def started(self, what: str, total: int | None) -> int:
        line = self._bars.add_task("  " * self._depth + what, total=total, left="")
        self._depth += 1
        self._paces[line] = Pace(total, time.monotonic())
        return int(line)

    def advanced(self, line: int) -> None:
        pace = self._paces[line]
        pace.advance(time.monotonic())
        self._bars.update(TaskID(line), advance=1, left=_left(pace))

    def finished(self, line: int) -> None:
        self._depth -= 1
        del self._paces[line]
        self._bars.remove_task(TaskID(line))

    def said(self, text: str, is_fault: bool) -> None:
        self._bars.console.print(_painted(text, is_fault))


def _left(pace: Pace) -> str:
    return "" if pace.left_s is None else f"about {duration(pace.left_s)} left"


@dataclass
class _Line:
    what: str
    pace: Pace
    said: float


class _Lines:
    """A `progress.Watcher` for logs and pipes: a line at intervals, and one when outer work ends."""

    def __init__(self) -> None:
        self._lines: dict[int, _Line] = {}

    def started(self, what: str, total: int | None) -> int:
        now = time.monotonic()
        key = max(self._lines, default=0) + 1
        self._lines[key] = _Line(what, Pace(total, now), now)
        return key

    def advanced(self, line: int) -> None:
        shown_line, now = self._lines[line], time.monotonic()
        shown_line.pace.advance(now)
        if now - shown_line.said > _PLAIN_SECONDS and shown_line.pace.total:
            shown_line.said = now
            left = _left(shown_line.pace)
            err.print(f"{shown_line.what}: {shown_line.pace.done}/{shown_line.pace.total}{left and f', {left}'}")

    def finished(self, line: int) -> None:
        shown_line = self._lines.pop(line)
        seconds = time.monotonic() - shown_line.pace.started
        if not self._lines and seconds > _WORTH_A_LINE:
            err.print(f"{shown_line.what}: {shown_line.pace.done} done in {seconds:.1f} s")

    def said(self, text: str, is_fault: bool) -> None:
        err.print(_painted(text, is_fault))


def _painted(text: str, is_fault: bool) -> str:
    from rich.markup import escape

    return f"[red]{escape(text)}[/red]" if is_fault else escape(text)


def has_styles() -> bool:
    """Whether text on stdout may be styled."""
    return out.is_terminal and not out.is_dumb_terminal and not out.no_color


def table(left: Collection[str], right: Collection[str]) -> Table:
    """Return an empty table without lines, its columns in this order: of words, left-aligned, then of numbers."""
    made = Table(box=None, header_style="bold", pad_edge=False, padding=(0, 2, 0, 0))
    for name in left:
        made.add_column(name, overflow="fold")
    for name in right:
        made.add_column(name, justify="right", no_wrap=True)
    return made


@contextmanager
def live() -> Iterator[None]:
    """Show the progress of this block: bars in a terminal, lines elsewhere."""
    if not sys.stderr.isatty() or err.is_dumb_terminal:
        with plain():
            yield
        return
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(bar_width=30),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
    )
    with Progress(*columns, console=err) as bars, progress.watched_by(_Bars(bars)):
        yield


@contextmanager
def plain() -> Iterator[None]:
    """Show the progress of this block as lines."""
    with progress.watched_by(_Lines()):
        yield
