"""Stored pictures that something else has changed do not count as stored; copies of a whole folder do."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from support.command_line import calls, succeeded
from support.places import TOYS

RUN = ("run", "--plugin", str(TOYS), "dataset=toy", "method=gain", "method.gain=0.5")
RUN += ("metrics=[coverage]", "tracking.uri=off", "report=false", "out=results")
RUN += ("method.log=log", "save=full")
STORED = Path("restored/toy/gain/v1")


def restored_views(folder: Path) -> list[str]:
    """The views that the command restores."""
    (folder / "log").unlink(missing_ok=True)
    succeeded(folder, *RUN)
    return calls(folder / "log")


BAD_RECORDS = {
    "none": None,
    "other": b"[]",
    "deep": b"[" * 100_000,
    "cut": b'{"files": {',
    "raw": b"\xff",
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    assert restored_views(folder) == ["v0.png", "v1.png", "v2.png"]
    return folder


@pytest.mark.parametrize("record", BAD_RECORDS.values(), ids=BAD_RECORDS)
def test_a_view_without_a_whole_record_is_written_again_and_others_are_not(
    whole: Path, tmp_path: Path, record: bytes | None
):
    shutil.copytree(whole / "results", tmp_path / "results", copy_function=shutil.copyfile)
    path = (tmp_path / "results" / STORED).with_suffix(".json")
    if record is None:
        path.unlink()
    else:
        path.write_bytes(record)
    pictures = [path.with_name(f"v{n}.png") for n in range(3)]
    before = [picture.stat().st_mtime_ns for picture in pictures]
    assert restored_views(tmp_path) == []  # the .npz has all of it
    after = [picture.stat().st_mtime_ns for picture in pictures]
    assert np.greater(after, before).tolist() == [False, True, False]
    assert json.loads(path.read_text())["files"].keys() == {".png", ".npz"}


def test_a_picture_that_was_cut_short_is_written_again(whole: Path, tmp_path: Path):
    shutil.copytree(whole / "results", tmp_path / "results", copy_function=shutil.copyfile)
    picture = tmp_path / "results" / STORED.with_suffix(".png")
    before = picture.read_bytes()
    picture.write_bytes(before[:-20])
    restored_views(tmp_path)
    assert picture.read_bytes() == before
