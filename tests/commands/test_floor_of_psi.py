"""A run with charts on linear camera data says what psi cannot fall below."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from support.colmap_folder import HEIGHT, WIDTH, write_dive
from support.command_line import Done


@pytest.mark.parametrize("encoding", ["linear", "gamma"])
def test_only_linear_data_have_a_floor(
    tmp_path: Path, bench: Callable[..., Done], encoding: str
) -> None:
    dive = write_dive(tmp_path / "dive")
    corners = [[1, 1], [WIDTH - 1, 1], [WIDTH - 1, HEIGHT - 1], [1, HEIGHT - 1]]
    (dive / "charts.json").write_text(
        json.dumps({"kind": "colorchecker24", "images": {"a.png": {"near": corners}}})
    )
    words = (
        "dataset=./dive",
        f"dataset.encoding={encoding}",
        "method=gray_world",
        "metrics=[psi]",
        "report=false",
    )
    done = bench("run", *words, "tracking.uri=off", "workers=0")
    assert ("psi" in done.stderr and "# camera:" in done.stderr) == (encoding == "linear"), (
        done.stderr
    )
