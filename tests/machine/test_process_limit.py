"""A limit on processes, as a user's commands meet it."""

from __future__ import annotations

import errno
import os
import resource
import subprocess
import sys

import pytest

from sucre_bench.machine.process_limit import want_of_processes

pytestmark = pytest.mark.short


@pytest.mark.parametrize(
    ("fault", "is_want"),
    [
        (RuntimeError("can't start new thread"), True),
        (BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN)), True),
        (BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN), "a.pipe"), False),
        (RuntimeError("another"), False),
    ],
)
def test_a_thread_or_process_that_cannot_be_started_is_known_by_its_error(fault: Exception, is_want: bool):
    assert ("ulimit -u" in want_of_processes(fault)) == is_want


@pytest.mark.skipif(os.getuid() == 0, reason="no limit on processes holds for root")
def test_too_low_a_limit_is_one_line_before_any_library_loads():
    words = [sys.executable, "-c", "from sucre_bench.cli import main; main()", "list", "methods"]

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_NPROC, (2, 2))

    done = subprocess.run(words, preexec_fn=limit, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "ulimit -u" in done.stderr
