"""The error classes, and checks of user input. A message is one line: ``place: fault; remedy``."""

from __future__ import annotations

import copyreg
import difflib
import errno
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from numbers import Real
from typing import Any, Literal


class SucreBenchError(Exception):
    """The base class of all errors that the user can mend. The command line prints their message as one line.

    fault: what is wrong; place: the file, folder or option that is wrong; remedy: what the user can do; text: the
    message without the place. Give the three apart: other code shows one of them without the others. Given a message
    as one text, `place` and `remedy` are empty, and `without_remedy` and `beside` return all of it.

    >>> issubclass(InputError, SucreBenchError)
    True
    >>> str(InputError("is damaged", "a.png", "copy it again"))
    'a.png: is damaged; copy it again'
    """

    def __init__(self, fault: str = "", place: object = "", remedy: str = "") -> None:
        self.fault = fault
        self.place = str(place)
        self.remedy = remedy
        self.text = f"{fault}; {remedy}" if remedy else fault
        super().__init__(self._at_place(self.text))

    def __reduce__(self) -> tuple[Any, ...]:
        # Without `__init__`, for some errors have other parameters.
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]

    @property
    def without_remedy(self) -> str:
        """The message without what the user can do."""
        return self._at_place(self.fault)

    def _at_place(self, text: str) -> str:
        text = f"{self.place}: {text}" if self.place else text
        return text if isinstance(self, LinesError) else shortened(escaped_breaks(text))

    def beside(self, place: object) -> str:
        """Return the message where a place is named already: without it, if it is the error's own."""
        return self.text if self.place == str(place) else str(self)

    def within(self, place: object) -> InputError:
        """Return the error with a place before its own: the file that holds a wrong name, say."""
        return InputError(self.without_remedy, place, self.remedy)


class LinesError(SucreBenchError):
    """Several faults, a line each."""


class InputError(SucreBenchError):
    """A file, folder, option or name is wrong.

    >>> import sucre_bench as sb
    >>> try:
    ...     next(sb.load_scenes("demmo"))
    ... except sb.InputError as fault:
    ...     print("did you mean 'demo'" in str(fault))
    True
    """


class FileError(InputError):
    """A file or folder cannot be used. place: its path, or the option that names it."""


class MissingFileError(FileError):
    """Nothing is there."""


class NotAFileError(FileError):
    """A path leads to a folder, a pipe or a device, or no file system can have it."""


class NotAFolderError(FileError):
    """A path leads to a file, where a folder is expected."""


class ForbiddenFileError(FileError):
    """The system does not let this user read a file."""


class DamagedFileError(FileError):
    """The content of a file is not what it should be: cut short, changed, or of another kind."""


_KINDS = {
    FileNotFoundError: MissingFileError,
    PermissionError: ForbiddenFileError,
    IsADirectoryError: NotAFileError,
}

# Numbers of errors about the content: a decoder's own error has none, and a damaged offset is an invalid one.
_OF_CONTENT = (None, errno.EINVAL)


def file_error(path: object, fault: OSError, remedy: str) -> FileError:
    """Return the error for a file that could not be read, of the class that tells the cause.

    The class is FileError itself where the fault is not the file's: too many open files, say, or a disk that fails.
    """
    otherwise = DamagedFileError if fault.errno in _OF_CONTENT else FileError
    kind = next(
        (ours for theirs, ours in _KINDS.items() if isinstance(fault, theirs)), otherwise
    )
    return kind(f"cannot be read, {fault.strerror or fault}", path, remedy)


class OutputError(SucreBenchError):
    """Results cannot be written. The command stops; files that were written before stay complete."""


class DiskFullError(OutputError):
    """The disk is full, so that no other job can write either."""


class PluginError(SucreBenchError):
    """A plugin cannot be imported, or breaks the contract.

    >>> import sucre_bench as sb
    >>> try:
    ...     sb.load_file("no_such_plugin.py")
    ... except sb.PluginError as fault:
    ...     print(str(fault).endswith("give the path of a .py file"))
    True
    """


def raise_if_stop(fault: BaseException) -> None:
    """Raise an exception again if it asks for the end of the work, as Ctrl-C does."""
    if isinstance(fault, KeyboardInterrupt):
        raise fault


class DiedError(PluginError):
    """A plugin ended a process at a step, which is left out from then on. how: its exit code or signal.

    Rows store the text; `results.Reason` knows it by its first words.
    """

    def __init__(self, how: str, step: str) -> None:
        remedy = "mend the plugin, or try again with overwrite=failed"
        super().__init__(f"the process died ({how}) in {step}", remedy=remedy)


class SolveError(SucreBenchError):
    """An estimation has no meaningful answer for this input. The view has failed.

    >>> raise SolveError("a.png: no pixel has two observations; add views")
    Traceback (most recent call last):
    sucre_bench.errors.SolveError: a.png: no pixel has two observations; add views
    """


class NotApplicableError(SolveError):
    """A method or metric is not made for this view. The view is skipped, with this reason; nothing is wrong.

    >>> raise NotApplicableError("a.png: has no depth; run `sucre-bench prepare`")
    Traceback (most recent call last):
    sucre_bench.errors.NotApplicableError: a.png: has no depth; run `sucre-bench prepare`
    """


# What a plugin may raise. sys.exit in a plugin must not end a command; Ctrl-C must.
ANY_FAULT = (Exception, SystemExit)

_LONGEST = 1000  # characters of a message
_KEPT = 400  # of the ends of a longer one


@dataclass(frozen=True)
class Lack:
    """What a plugin needs and a scene or view lacks. Rows store its text, which begins with the code "needs ..."."""

    needs: tuple[str, ...]
    has: tuple[str, ...]
    of: Literal["scene", "view"] = "scene"

    def __str__(self) -> str:
        return f"needs {' and '.join(self.needs)}: the {self.of} has {', '.join(self.has) or 'only images'}"


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return "did you mean 'x'? " if a known name is similar, followed by all known names."""
    names = sorted(known)
    near = difflib.get_close_matches(word, names, n=1, cutoff=0.5)
    hint = f"did you mean '{near[0]}'? " if near else ""
    return f"{hint}known: {', '.join(names) or 'none'}"


def unknown_name(
    place: str, name: str, known: Iterable[str], what: str = "option"
) -> InputError:
    """Return the error for an unknown name; it suggests the nearest known name. place: as the user typed it."""
    return InputError(f"no {what} '{name}'", place, did_you_mean(name, known))


def is_number_in(interval: str, value: Any) -> bool:
    """Whether a value is a number in an interval, for example "[0, 1)"; "(" and ")" exclude the bound.

    NaN is in no interval. True and False are no numbers.
    """
    if isinstance(value, bool) or not isinstance(value, Real):
        return False
    number: Any = value  # not as a float: a whole number may be greater than any
    low, high = (float(bound) for bound in interval[1:-1].split(","))
    is_above = number > low if interval[0] == "(" else number >= low
    return bool(is_above and (number < high if interval[-1] == ")" else number <= high))


def check_number(place: str, value: Any, interval: str) -> None:
    """Raise InputError unless a value is a number in an interval, see `is_number_in`. place: as the user typed it."""
    if not is_number_in(interval, value):
        raise InputError(shown_value(value), place, f"give a number in {interval}")


# What `str.splitlines` breaks a line at, as Python writes it.
_BREAKS = {ord(sign): ascii(sign)[1:-1] for sign in "\n\r\v\f\x1c\x1d\x1e\x85\u2028\u2029"}


def escaped_breaks(text: str) -> str:
    """Return text with its line breaks as Python writes them: the name of a file may hold any."""
    return text.translate(_BREAKS)


def shortened(text: str) -> str:
    """Return the ends of a long text, which quotes a file: its place and its remedy stay."""
    return text if len(text) <= _LONGEST else f"{text[:_KEPT]} ... {text[-_KEPT:]}"


def is_utf8(text: str) -> bool:
    """Whether tables, pages and records can store a text; not so the name of a file in another encoding."""
    return not any("\ud800" <= sign <= "\udfff" for sign in text)


def in_one_line(text: object, how: Callable[[object], str] = str) -> str:
    """Return text from a file in a form for messages: line breaks become spaces, what is no UTF-8 is escaped."""
    try:
        return " ".join(how(text).split()).encode(errors="backslashreplace").decode()
    except Exception:  # of an object of the user's that has no text
        return ""


def shown_value(value: object) -> str:
    """Return a value as Python writes it, if that is short; else its type."""
    text = in_one_line(value, repr)
    return text if 0 < len(text) <= 40 else type(value).__name__


def one_line(fault: BaseException) -> str:
    """Return an exception as one line: its text, after its type unless it is an error of sucre_bench."""
    text = shortened(in_one_line(fault))
    if isinstance(fault, SucreBenchError):
        return text
    return f"{type(fault).__name__}: {text}" if text else type(fault).__name__


def in_words(fault: BaseException) -> str:
    """Return what reading a damaged file raised, without the names that Python has for it."""
    if isinstance(fault, KeyError):
        return f"it lacks {in_one_line(fault)}"
    if isinstance(fault, (TypeError, AttributeError, IndexError)):
        return "its content is of another kind"
    return in_one_line(fault).partition("; use ")[0] or "it is damaged"
