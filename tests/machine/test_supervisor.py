"""The sentence on a process that died. It names want of memory where that may be the reason."""

from __future__ import annotations

import resource
import signal

import pytest

from sucre_bench.machine.current_step import Note
from sucre_bench.machine.supervisor import how_it_ended


@pytest.mark.parametrize(
    ("limit_gb", "number", "is_named"),
    [
        (4, signal.SIGSEGV, True),
        (4, signal.SIGABRT, True),
        (4, signal.SIGILL, False),
        (1000, signal.SIGSEGV, False),
        (1000, signal.SIGKILL, True),  # as the system does, whatever the limit
        (None, signal.SIGSEGV, False),
        (None, signal.SIGKILL, True),
    ],
)
def test_want_of_memory_is_named_where_it_may_be_the_reason(
    monkeypatch: pytest.MonkeyPatch, limit_gb: int | None, number: signal.Signals, is_named: bool
):
    limit = resource.RLIM_INFINITY if limit_gb is None else limit_gb * 10**9
    monkeypatch.setattr(resource, "getrlimit", lambda _: (limit, limit))
    how = how_it_ended(-number, Note())
    assert f"signal {int(number)}" in how
    assert ("memory" in how) == is_named
    assert ("ulimit" in how) == (is_named and limit_gb == 4)
