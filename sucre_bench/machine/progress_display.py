"""Shows progress on stderr: bars with an estimate in a terminal, plain lines in a pipe or a log.

Work reports it with `machine.progress`. TERM=dumb gets plain lines, too.
"""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TaskID, TextColumn, TimeElapsedColumn

from sucre_bench.machine import progress
from sucre_bench.machine.terminal import err
from sucre_bench.machine.time_left import Pace, duration

_PLAIN_SECONDS = 10.0
_WORTH_A_LINE = 1.0
_DRAWN_SECONDS = 0.1


class _Bars:
    """A `progress.Watcher` that draws bars. Inner work stands below outer work, and is removed when it is done."""

    def __init__(self, bars: Progress) -> None:
        self._bars = bars
        self._depth = 0
        self._paces: dict[int, Pace] = {}
        self._drawn = 0.0

    def started(self, what: str, total: int | None) -> int:
        line = self._bars.add_task("  " * self._depth + what, total=total, left="")
        self._depth += 1
        self._paces[line] = Pace(total, time.monotonic())
        self.tick()
        return int(line)

    def advanced(self, line: int) -> None:
        pace = self._paces[line]
        pace.advance(time.monotonic())
        self._bars.update(TaskID(line), advance=1, left=_left(pace))
        self.tick()

    def finished(self, line: int) -> None:
        self._depth -= 1
        del self._paces[line]
        self._bars.remove_task(TaskID(line))

    def said(self, text: str, is_fault: bool) -> None:
        self._bars.console.print(_painted(text, is_fault))

    def tick(self) -> None:
        """Draw, at most ten times a second. No thread does it: this process forks others."""
        if time.monotonic() - self._drawn >= _DRAWN_SECONDS:
            self._bars.refresh()
            self._drawn = time.monotonic()


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

    def tick(self) -> None:
        pass


def _painted(text: str, is_fault: bool) -> str:
    from rich.markup import escape

    return f"[red]{escape(text)}[/red]" if is_fault else escape(text)


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
    with Progress(*columns, console=err, auto_refresh=False) as bars, progress.watched_by(_Bars(bars)):
        yield


@contextmanager
def plain() -> Iterator[None]:
    """Show the progress of this block as lines."""
    with progress.watched_by(_Lines()):
        yield
