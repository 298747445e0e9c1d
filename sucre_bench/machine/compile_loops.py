"""Compiles the loops of this package at their first call, and prints a line about it."""

import functools
import sys
from collections.abc import Callable
from typing import Any


@functools.cache
def compiled(loop: Callable[..., Any]) -> Callable[..., Any]:
    """Return a module's function compiled by numba, imported here and not before; the result is cached on disk if
    there is a place.

    The first compilation of a process is announced in one line. Code that is read from the disk is not compiled.
    The function uses no threads: its callers are threads, and numba's default threading layer allows one caller only.
    """
    import numba

    _announce_compiling()
    made: Callable[..., Any]
    try:
        made = numba.njit(nogil=True, cache=True, error_model="numpy")(loop)
    except RuntimeError:  # neither the folder of the package nor the user's cache can be written
        made = numba.njit(nogil=True, error_model="numpy")(loop)
    return made


@functools.cache
def _announce_compiling() -> None:
    """Let numba report when it compiles."""
    from numba.core import event

    class FirstCompilation(event.Listener):
        def on_start(self, event: object) -> None:
            _say_that_it_compiles()

        def on_end(self, event: object) -> None:
            pass

    event.register("numba:compile", FirstCompilation())


@functools.cache
def _say_that_it_compiles() -> None:
    from sucre_bench.machine import progress

    text = "compiling loops for this processor, once after each installation or update; this takes up to a minute"
    if progress.is_watched():
        progress.say(text)
    else:  # a script, a notebook, or a thread
        print(text, file=sys.stderr)
