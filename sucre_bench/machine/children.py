"""Starts child processes that import no Python files of the current folder."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_SAFE_PATH = "PYTHONSAFEPATH"
_OURS = "sucre-bench"  # any word switches it on; this one says who did


def python(*arguments: str) -> list[str]:
    """Return the command line of this Python that does not import from the current folder."""
    return [sys.executable, "-P", *arguments]


@contextmanager
def isolated_children() -> Iterator[None]:
    """Let no Python that is started in this block import from the current folder, libraries' worker processes included.

    Without it, `python -m` and `python -c` find a `json.py` of the current folder before Python's own.
    """
    if os.environ.get(_SAFE_PATH):
        yield
        return
    os.environ[_SAFE_PATH] = _OURS
    try:
        yield
    finally:
        os.environ.pop(_SAFE_PATH, None)


def environment_of_programs() -> dict[str, str]:
    """Return the environment for a program of the user's, which may import what lies beside it."""
    environment = dict(os.environ)
    if environment.get(_SAFE_PATH) == _OURS:
        del environment[_SAFE_PATH]
    return environment
