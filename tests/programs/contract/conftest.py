"""What the tests of the contract share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from sucre_bench.plugins import registry


@pytest.fixture
def only_built_in() -> Iterator[None]:
    """Plugins loaded by a test are forgotten after it."""
    with registry.only_built_in():
        yield
