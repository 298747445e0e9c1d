"""Rights that are missing, full disks, limits: one line, another exit code than 0, and nothing finished is lost."""

from __future__ import annotations

import functools
import re
from pathlib import Path

import pytest
from support.colmap_folder import write_dive
from support.command_line import PROGRAM, Started, run_here
from support.refusing import as_user, on_small_disk, skip_unless_refused, with_small_files

from sucre_bench import results

RUN = "run -m dataset=colmap dataset.root=dive method=gray_world,underwater metrics=[coverage] tracking.uri=off"
RESULTS = f"{RUN} report=false save=full out=results"

# What this user must not do, a command, and a pattern of its line.
FORBIDDEN: dict[str, tuple[str, int, str, str]] = {
    "enter a dataset": ("dive", 0o600, f"{RUN} out=x", r"dive/\S+: .*Permission denied; "),
    "enter a folder of images": ("dive/images", 0o600, f"{RUN} out=x", r"dive/images/a\.png: .*Permission denied; "),
    "list a folder of images": (
        "dive/images",
        0o300,
        "run dataset=photos dataset.root=dive/images method=gray_world out=x",
        r"dive/images: .*Permission denied; ",
    ),
    "enter a folder of photos": ("dive/images", 0o600, "prepare dive/images x", r"\ba\.png .*Permission"),
    "read a score table": ("results/scores.parquet", 0o200, "compare results", r"parquet: .*Permission denied; let"),
    "read the score table of a run": ("results/scores.parquet", 0o200, RESULTS, r"parquet: .*Permission denied; let"),
    "enter a results folder": ("results", 0o600, "compare results", r"results/.*Permission denied; let"),
    "list the parts of a score table": (
        "parted/parts",
        0o300,
        "compare parted",
        r"parted/parts: .*Permission denied; let",
    ),
    "write into a results folder": ("results", 0o500, RESULTS, r"results/.*: .*written.*; "),
    "write a plugin": ("full", 0o500, "new method mine --package full", r"full/.*: .*written.*; "),
}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("refused")
    write_dive(folder / "dive", ("a.png", "b.png"))
    (folder / "full").mkdir()
    (folder / "parted" / "parts").mkdir(parents=True)
    assert run_here(folder, *RESULTS.split()).returncode == 0
    return folder


@pytest.mark.parametrize(("path", "mode", "command", "said"), FORBIDDEN.values(), ids=FORBIDDEN)
def test_a_missing_right_is_one_line(place: Path, path: str, mode: int, command: str, said: str):
    skip_unless_refused(place)
    before = results.read(place / "results")
    usual = (place / path).stat().st_mode
    (place / path).chmod(mode)
    try:
        done = Started(place, *command.split(), before=as_user).ended()
    finally:
        (place / path).chmod(usual)
    assert done.returncode == 2
    assert re.search(said, done.stderr), done.stderr
    assert "Traceback" not in done.stdout + done.stderr
    assert len(done.errors) == 1
    assert results.read(place / "results").equals(before)


def test_stored_restorations_that_cannot_be_replaced_keep_their_rows(place: Path):
    skip_unless_refused(place)
    before = results.read(place / "results")
    folder = place / "results" / "restored" / "colmap" / "gray_world"
    folder.chmod(0o500)
    try:
        done = Started(place, *RESULTS.split(), "overwrite=always", before=as_user).ended()
    finally:
        folder.chmod(0o700)
    assert done.returncode != 0
    assert re.search(r"gray_world/a\.\w+: .*written.*; ", done.stdout + done.stderr)
    of_method = before[before["method"] == "gray_world"]
    after = results.read(place / "results")
    assert after[after["method"] == "gray_world"].reset_index(drop=True).equals(of_method.reset_index(drop=True))
    assert set(after["status"].unique()) == {"ok"}


def test_a_disk_that_fills_in_the_middle_keeps_what_is_finished(place: Path, tmp_path: Path):
    (tmp_path / "dive").symlink_to(place / "dive")
    needed = sum(path.stat().st_blocks * 512 for path in (place / "results").rglob("*") if path.is_file())
    run = f"'{PROGRAM}' {RESULTS.replace('out=results', 'out=disk')}"
    steps = (f"{run} 2>first", "echo $?", "cp -r disk kept", "mount -o remount,size=64M disk", f"{run} 2>second")
    script = "; ".join((*steps, "echo $?", "cp -r disk end"))
    done = on_small_disk(tmp_path, "disk", needed * 2 // 3, script)
    first, second = (int(line) for line in done.stdout.splitlines() if line.strip().isdigit())
    assert first in (1, 2), done.stderr
    assert second == 0, done.stderr
    assert re.search(r"disk/.*: .*disk.*; ", (tmp_path / "first").read_text())
    assert "Traceback" not in (tmp_path / "first").read_text()
    kept, end = results.read(tmp_path / "kept"), results.read(tmp_path / "end")
    assert set(kept["status"].unique()) == {"ok"}
    assert 0 < len(kept) < len(end) == len(results.read(place / "results"))
    assert set(end["status"].unique()) == {"ok"}


def test_a_limit_on_the_size_of_files_stops_a_run_with_a_remedy_that_works(place: Path, tmp_path: Path):
    (tmp_path / "dive").symlink_to(place / "dive")
    words = [*RESULTS.split(), "out=small"]
    done = Started(tmp_path, *words, before=functools.partial(with_small_files, 4096)).ended()
    assert done.returncode in (1, 2)
    assert re.search(r"small/\S+: .*; .*ulimit -f", done.stdout + done.stderr)
    assert "Traceback" not in done.stdout + done.stderr
    assert run_here(tmp_path, *words).returncode == 0
    assert set(results.read(tmp_path / "small")["status"].unique()) == {"ok"}
