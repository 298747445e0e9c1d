"""What the tests of the contract share."""

import os
from collections.abc import Iterator
from unittest import mock

import pytest


@pytest.fixture
def own_environment() -> Iterator[None]:
    """Variables that a plugin sets are gone after the test."""
    with mock.patch.dict(os.environ):
        yield
