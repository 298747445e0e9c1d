"""The current step of a process, noted where another process can read it if this one dies.

A plugin may end the process: a segmentation fault, `os._exit`, the system for want of memory. Whoever goes on then
knows the step, and leaves it out: `step` raises `DiedError` for a step at which a process has died before.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from sucre_bench.errors import Death, DiedError
from sucre_bench.machine.files import not_writable

_TRIES = 3  # processes that may end at a step without a word, where nobody saw how


@dataclass(frozen=True)
class Note:
    """What a process has noted. step: where it is, "" between steps; limit_s: how long that may take, from `since`
    (`time.monotonic`); start: when the command started, as rows have it; status: its exit code once it has ended;
    tries: how many processes have ended at that step; remedy: what the user can do if it dies at a step that cannot be
    left out, else "".
    """

    step: str = ""
    limit_s: float | None = None
    since: float = 0.0
    start: str = ""
    status: int | None = None
    tries: int = 0
    remedy: str = ""

    @property
    def is_late(self) -> bool:
        """Whether the step has taken longer than it may."""
        return self.limit_s is not None and time.monotonic() - self.since >= self.limit_s


@dataclass
class NoteFile:
    """A file that holds one note; a write is a microsecond and survives the process, though not the computer."""

    descriptor: int

    @classmethod
    def in_memory(cls) -> NoteFile:
        """Return a note that only this process and its children see."""
        return cls(os.memfd_create("sucre-bench"))

    @classmethod
    def at(cls, path: Path) -> NoteFile:
        """Open a note on the disk, perhaps one that an earlier process has left. Raises OutputError if it cannot."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            return cls(os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644))
        except OSError as fault:
            raise not_writable(path, fault) from fault

    def read(self) -> Note:
        """Return the note; an empty one if there is none."""
        with suppress(ValueError, TypeError, OSError):
            return Note(**json.loads(os.pread(self.descriptor, 1 << 16, 0).partition(b"\0")[0]))
        return Note()

    def close(self) -> None:
        """Close the file."""
        os.close(self.descriptor)

    def write(self, note: Note) -> None:
        """Replace the note."""
        with suppress(OSError):  # a full disk is said by whoever writes results
            os.pwrite(self.descriptor, json.dumps(asdict(note)).encode() + b"\0", 0)


@dataclass
class _AtWork:
    """The note of this process; the steps at which others have died, with how."""

    file: NoteFile | None = None
    note: Note = field(default_factory=Note)
    left: Note = field(default_factory=Note)  # by an earlier process, of which nobody knows how it ended
    deaths: Mapping[str, str] = field(default_factory=dict)
    start: str = ""

    def set(self, note: Note) -> None:
        self.note = note
        if self.file:
            self.file.write(note)


_own = _AtWork()


@contextmanager
def at_work(file: NoteFile, deaths: Mapping[str, str], start: str = "") -> Iterator[None]:
    """Note the steps of this block in a file. deaths: the steps to leave out, with how the process died there; start:
    when the command started that this process goes on with, "" if it is the first.
    """
    global _own
    before, left = _own, file.read()
    _own = _AtWork(file, Note(start=start), left, deaths, start)
    try:
        yield
    finally:
        _own = before


def note_start(start: str) -> str:
    """Note when the command started, as rows have it; return that of the process that died, if this one goes on."""
    _own.set(replace(_own.note, start=_own.start or start))
    return _own.start or start


def earlier_start() -> str:
    """Return when the command started that this process goes on with; "" if it is the first."""
    return _own.start


@contextmanager
def needed_step(name: str, remedy: str) -> Iterator[None]:
    """Note a step that cannot be left out: if the process dies there, the command ends and says the remedy."""
    before = _own.note
    _own.set(replace(before, step=name, limit_s=None, remedy=remedy))
    try:
        yield
    finally:
        _own.set(before)


@contextmanager
def step(name: str, limit_s: float | None = None) -> Iterator[None]:
    """Note that this process is at a step, by a name that is the same in every process.

    Raises DiedError if one has died there: of the command, or twice in earlier commands that nobody watched.
    """
    if how := _own.deaths.get(name):
        raise DiedError(str(Death(how, name)))
    tries = _own.left.tries if _own.left.step == name else 0
    if tries >= _TRIES:
        raise DiedError(str(Death(f"{tries} times, unseen", name)))
    before = _own.note
    _own.set(replace(before, step=name, limit_s=limit_s, since=time.monotonic(), tries=tries + 1, remedy=""))
    try:
        yield
    finally:
        _own.set(before)
