"""Stored pictures that something else has changed do not count as stored; copies of a whole folder do."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from support.command_line import run_here
from support.places import TOYS

RUN = ("run", "--plugin", str(TOYS), "dataset=toy", "method=gain", "method.gain=0.5", "metrics=[coverage]")
MORE = ("tracking.uri=off", "report=false", "out=results", "method.log=log", "save=full")
STORED = Path("restored/toy/gain/v1")


def restored_views(folder: Path) -> list[str]:
    """The views that the command restores."""
    (folder / "log").unlink(missing_ok=True)
    assert run_here(folder, *RUN, *MORE).returncode == 0
    return (folder / "log").read_text().split() if (folder / "log").exists() else []


def other_time(path: Path) -> None:
    os.utime(path, (0, 0))


CHANGES: dict[str, tuple[str, Callable[[Path], None], bool]] = {
    "another picture": (".png", lambda path: shutil.copyfile(path.with_name("v0.png"), path), True),
    "empty": (".png", lambda path: path.write_bytes(b""), True),
    "gone": (".png", Path.unlink, True),
    "another time": (".png", other_time, False),
    "no record": (".json", Path.unlink, True),
    "a record that is none": (".json", lambda path: path.write_text("[]"), True),
    "a deep record": (".json", lambda path: path.write_text("[" * 100_000), True),
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    assert restored_views(folder) == ["v0.png", "v1.png", "v2.png"]
    return folder


@pytest.mark.parametrize(("suffix", "change", "is_other"), CHANGES.values(), ids=CHANGES)
def test_a_changed_file_is_written_again_and_a_copied_one_is_not(
    whole: Path, tmp_path: Path, suffix: str, change: Callable[[Path], None], is_other: bool
):
    before = (whole / "results" / STORED.with_suffix(".png")).read_bytes()
    shutil.copytree(whole / "results", tmp_path / "results", copy_function=shutil.copyfile)  # with other times
    path = tmp_path / "results" / STORED.with_suffix(suffix)
    change(path)
    changed = path.read_bytes() if path.exists() else None
    assert restored_views(tmp_path) == []  # the .npz has all of it
    assert (path.read_bytes() != changed) == is_other
    assert (tmp_path / "results" / STORED.with_suffix(".png")).read_bytes() == before
