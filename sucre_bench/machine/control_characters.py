"""Writes out control characters in text from files, names and rows before a terminal shows it: ESC as "\\x1b".

A name may hold an escape sequence that clears the screen, or forges the lines of a command. If a terminal or pipe lacks
some letters, it gets others of the same width.
"""

import codecs
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO

# C0 and C1 but tab and newline; what reverses the direction of text; halves of characters, which no output encodes.
_UNSAFE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")

# What stands for a letter where the output's encoding lacks it. Each is as wide, so that columns stay aligned.
_PLAIN = str.maketrans("↑↓≈○±−–·×✓✗…’“”│─▾█━╸╺", '^v~o+--.x+x.\'""|-v#---')
_FEWER_LETTERS = "sucre_bench_fewer_letters"


def with_fewer_letters() -> None:
    """Let stdout and stderr write what their encoding lacks with other letters: ^ for an arrow, ? for the rest."""
    codecs.register_error(_FEWER_LETTERS, _replaced)
    for stream in (sys.stdout, sys.stderr):
        try:
            "↑≈".encode(stream.encoding or "utf-8")
        except UnicodeEncodeError:
            stream.reconfigure(errors=_FEWER_LETTERS)  # type: ignore[union-attr]
        except (LookupError, AttributeError):
            continue


def _replaced(fault: UnicodeError) -> tuple[str, int]:
    assert isinstance(fault, UnicodeEncodeError)
    text = fault.object[fault.start : fault.end].translate(_PLAIN)
    return "".join(letter if letter.isascii() else "?" for letter in text), fault.end


def escaped(text: str) -> str:
    r"""Return a text with control characters written out.

    >>> print(escaped("a\x1b[2J.png"))
    a\x1b[2J.png
    """
    return _UNSAFE.sub(lambda found: ascii(found[0])[1:-1], text)


class _Escaped:
    """A stream that writes out control characters. rich, whose colours are our own, writes past it."""

    def __init__(self, stream: TextIO) -> None:
        self.rich_proxied_file = stream

    def write(self, text: str) -> int:
        return self.rich_proxied_file.write(escaped(text))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rich_proxied_file, name)


@contextmanager
def escaped_output() -> Iterator[None]:
    """Write out control characters of all that is printed in this block, but for what rich styles."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (_Escaped(stream) for stream in before)
    try:
        yield
    finally:  # what a plugin has closed stays replaced
        sys.stdout, sys.stderr = (
            old if not old.closed else new for old, new in zip(before, (sys.stdout, sys.stderr), strict=True)
        )
