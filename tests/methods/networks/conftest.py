"""What the tests of the networks share."""

from pathlib import Path

import pytest
from support.made_networks import ARCHITECTURES, weights_file


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("weights")
    return {method: weights_file(method, folder) for method in ARCHITECTURES}
