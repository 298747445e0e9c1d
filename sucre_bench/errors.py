"""What can go wrong for a user. A message reads ``place: fault; remedy`` and fits on one line."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

__all__ = [
    "ANY_FAULT",
    "InputError",
    "NotApplicableError",
    "OutputError",
    "PluginError",
    "SolveError",
    "SucreBenchError",
    "did_you_mean",
    "one_line",
]


class SucreBenchError(Exception):
    """The base of every error that is the user's to mend; the command line prints it as one line."""


class InputError(SucreBenchError):
    """A file, folder, option or name that was given is wrong."""


class OutputError(SucreBenchError):
    """Results cannot be written: nothing can go on, and nothing that was written is harmed."""


class PluginError(SucreBenchError):
    """A method, dataset or metric does not import, or does not keep its side of the contract."""


class SolveError(SucreBenchError):
    """An estimation has no meaningful answer on this input."""


class NotApplicableError(SolveError):
    """A method has nothing to say about a view, and nothing is wrong: the view is skipped, with the reason."""


# What foreign code may do to us: sys.exit in a plugin must not end the bench, Ctrl-C must.
ANY_FAULT = (Exception, SystemExit)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return ``"did you mean 'x'? "`` when a known name is near, and always what there is."""
    names = sorted(known)
    near = difflib.get_close_matches(word, names, n=1, cutoff=0.5)
    hint = f"did you mean '{near[0]}'? " if near else ""
    return f"{hint}known: {', '.join(names) or 'none'}"


def one_line(fault: BaseException) -> str:
    """Return an exception as one line: our own as they are, others with their type."""
    text = " ".join(str(fault).split())
    if isinstance(fault, SucreBenchError):
        return text
    return f"{type(fault).__name__}: {text}" if text else type(fault).__name__
