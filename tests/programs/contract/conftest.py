"""What the tests of the contract share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from sucre_bench.plugins import registry
from sucre_bench.plugins.registry import discover


@pytest.fixture
def only_built_in(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Plugins loaded by a test are forgotten after it."""
    monkeypatch.setattr(registry, "_files", {})
    discover.cache_clear()
    yield
    discover.cache_clear()
