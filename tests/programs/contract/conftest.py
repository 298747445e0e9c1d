"""What the tests of the contract share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from sucre_bench import plugins


@pytest.fixture
def only_built_in() -> Iterator[None]:
    """Plugins loaded by a test are forgotten after it."""
    with plugins.using(plugins.Registry()):
        yield
