"""What the tests of the engine share: the toy plugins, and the command line as a user runs it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
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
def bench(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run `sucre-bench ARGUMENTS` in an empty folder, with plain output."""

    def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [str(Path(sys.executable).with_name("sucre-bench")), *arguments],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
            timeout=300,
            env={**os.environ, "COLUMNS": "200", **environment},
        )

    return run
