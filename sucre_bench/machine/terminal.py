"""The consoles for stdout and stderr, and tables on them.

NO_COLOR removes colours. TERM=dumb or a pipe removes every escape code. FORCE_COLOR brings colours, but no bars, to a
pipe, such as the log of a CI.
"""

import sys
from collections.abc import Collection, Iterable
from typing import IO

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table

from sucre_bench.machine.control_characters import escaped


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
            yield Segment(text if control else escaped(text), style, control)


out = _Console(highlight=False, soft_wrap=not sys.stdout.isatty())
err = _Console(stderr=True, highlight=False, soft_wrap=not sys.stderr.isatty())


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
