"""What the tests of the engine share: the toy plugins, and the command line as a user runs it."""

from __future__ import annotations

import functools
import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy and torch: there is a process of tests for each core

from support.command_line import Done, run_here, run_program
from support.places import TOYS

from sucre_bench import plugins

# A shell without job control starts what it puts behind (`.ci/run &`) deaf to Ctrl-C, and all its children are born
# so; the programs that tests interrupt must hear it.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def toys() -> str:
    """The toy plugins, loaded in this process; the path of their file for other processes."""
    plugins.load_file(TOYS)
    return str(TOYS)


@pytest.fixture
def only_built_in() -> Iterator[None]:
    """No plugin file is loaded, and those that the test loads are forgotten after it."""
    with plugins.using(plugins.Registry()):
        yield


@pytest.fixture
def bench(tmp_path: Path) -> Callable[..., Done]:
    """Run `sucre-bench ARGUMENTS` in an empty folder, with plain output, in this process."""
    return functools.partial(run_here, tmp_path)


@pytest.fixture
def program(tmp_path: Path) -> Callable[..., Done]:
    """Run `sucre-bench ARGUMENTS` in an empty folder as a process of its own; keywords are its environment."""
    return functools.partial(run_program, tmp_path)
