"""What a terminal shows: consoles for stdout and stderr, tables, notices; control characters of names written out.

NO_COLOR removes colours. TERM=dumb or a pipe removes every escape code. FORCE_COLOR brings colours, but no bars, to a
pipe, such as the log of a CI. A file's name may hold an escape sequence that clears the screen, or forges the lines of
a command: ESC becomes "\\x1b" in all that rich prints.
"""

import io
import re
import sys
from collections.abc import Collection, Iterable

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from sucre_bench.machine.text_formats import masked

# Control characters but tab and newline, and halves of characters, which no output encodes.
_UNSAFE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")


class _Console(Console):
    """A console that writes out control characters of names and texts; styles are its own."""

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        for text, style, control in super().render(renderable, options):
            escaped = _UNSAFE.sub(lambda found: ascii(found[0])[1:-1], text)
            yield Segment(text if control else escaped, style, control)

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


out = _Console(highlight=False, soft_wrap=not sys.stdout.isatty())
err = _Console(stderr=True, highlight=False, soft_wrap=not sys.stderr.isatty())


def table(left: Collection[str], right: Collection[str]) -> Table:
    """Return an empty table without lines, its columns in this order: of words, left-aligned, then of numbers."""
    made = Table(box=None, header_style="bold", pad_edge=False, padding=(0, 2, 0, 0))
    for name in left:
        made.add_column(name, overflow="fold")
    for name in right:
        made.add_column(name, justify="right", no_wrap=True)
    return made


def plain(renderable: RenderableType, width: int) -> str:
    """Return as text, without styles, what rich would print in a terminal of this width."""
    console = Console(file=io.StringIO(), width=width)
    with console.capture() as captured:
        console.print(renderable)
    return "\n".join(line.rstrip() for line in captured.get().rstrip().split("\n"))


def show(*parts: str | Text | tuple[str, str], style: str = "") -> None:
    """Print a line on stdout, however long. parts: texts, or each with its style."""
    out.print(Text.assemble(*parts, style=style), soft_wrap=True)


def say(text: str, colour: str) -> None:
    """Print a notice, a fault say, as a line on stderr, in colour if stderr is a terminal that wants colours."""
    err.print(Text(masked(text), style=colour), soft_wrap=True)
