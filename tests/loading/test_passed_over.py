"""What lies unread in the folders of a dataset is counted and named by its kind."""

from pathlib import Path

import numpy as np
import pytest
from support.colmap_folder import picture, write_dive, write_image
from support.messages import Lines

from sucre_bench.engine.preflight import select
from sucre_bench.errors import InputError
from sucre_bench.loading import passed_over
from sucre_bench.machine import progress
from sucre_bench.programs.score_folder import score_folder


def said_of(work: object, monkeypatch: pytest.MonkeyPatch) -> str:
    said = Lines()
    monkeypatch.setattr(passed_over, "_said", set())
    with progress.watched_by(said):
        work()  # type: ignore[operator]
    (line,) = [line for line in said.lines if "not read" in line] or [""]
    return line


def photographs(folder: Path, *others: str) -> Path:
    for name in ("a.png", "b.png"):
        write_image(folder / name, picture(0))
    for name in others:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(b"no picture")
    return folder


def test_a_folder_of_photographs_says_what_else_it_holds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = photographs(
        tmp_path / "p",
        "c.HEIC",
        "d.heic",
        "e.GPR",
        "f.jp2",
        "g.xyz",
        "v.MP4",
        "README.md",
        ".hidden",
    )
    for work in (
        lambda: select(["dataset=photos", f"dataset.root={folder}"]),
        lambda: score_folder(folder, None, ["uciqe"]),
    ):
        line = said_of(work, monkeypatch)
        for part in ("2 .heic", "1 .gpr", "1 .jp2", "1 .xyz", "1 .mp4", "ffmpeg", "export"):
            assert part in line
        assert ".md" not in line


def test_a_dive_says_which_of_its_files_no_view_has(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dive = write_dive(tmp_path)
    assert not said_of(lambda: select(["dataset=colmap", f"dataset.root={dive}"]), monkeypatch)
    for name in (
        "images/unplaced.png",
        "depths/a.unknown",
        "depths/depth_a.txt",
        "depths/notes.txt",
        "stereo/b.png.geometric.bin",
        "depth_origin/a.png",
    ):
        (dive / name).parent.mkdir(exist_ok=True)
        (dive / name).write_bytes(np.random.default_rng(0).bytes(9))
    line = said_of(lambda: select(["dataset=colmap", f"dataset.root={dive}"]), monkeypatch)
    for part in (
        "1 .png in images",
        "1 .unknown in depths",
        "1 .txt in depths",
        "1 .geometric.bin in stereo",
    ):
        assert part in line
    assert "depth_origin" not in line


@pytest.mark.parametrize("name", ["a.mp4", "A.MOV"])
def test_a_video_says_what_takes_its_frames(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"\0\0\0\x18ftypmp42")
    for root in (tmp_path, tmp_path / name):
        with pytest.raises(InputError, match="ffmpeg -i"):
            select([f"dataset={root}"])
