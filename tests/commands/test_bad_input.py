"""Bad input, as the command line meets it: one line with the file and the remedy, and nothing finished is lost."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from support.colmap_folder import FORWARD, picture, write_dive, write_image, write_model
from support.command_line import Done, commands

from sucre_bench import results
from sucre_bench.errors import Lack

NAMES = ("a.png", "b.png", "c.png")
METHODS = "method=gray_world,stitching"


@pytest.fixture
def dive(tmp_path: Path) -> Path:
    return write_dive(tmp_path / "dive", NAMES)


def run(bench, dive: Path, *overrides: str):
    words = ["dataset=colmap", f"dataset.root={dive}", "method=gray_world", "metrics=[uciqe]"]
    quiet = ["tracking.uri=off", "report=false", "workers=0", "out=results"]
    return bench("run", "-m", *words, *quiet, *overrides)


def test_a_scene_without_depth_skips_what_needs_it_with_the_reason(bench, tmp_path: Path):
    dive = tmp_path / "dive"
    write_model(dive / "sparse", [(name, FORWARD, 1) for name in NAMES])
    for number, name in enumerate(NAMES):
        write_image(dive / "images" / name, picture(number))
    done = run(bench, dive, METHODS)
    assert done.returncode == 0
    assert (
        f"skipped  colmap / stitching / 3 views: {Lack(('depth',), ('poses',))}" in done.stdout
    )
    assert "3 ok, 0 failed, 3 skipped" in done.stdout


@pytest.mark.parametrize(("metrics", "code"), [("[psnr]", 1), ("[psnr,uciqe]", 0)])
def test_a_run_that_can_score_nothing_names_what_the_dataset_lacks(
    bench, dive: Path, metrics: str, code: int
):
    done = run(bench, dive, "views=[a.png]", f"metrics={metrics}")
    assert done.returncode == code
    (line,) = [line for line in done.stdout.splitlines() if line.startswith("not scored")]
    assert {"psnr:", "needs", "reference"} <= set(line.split())


def test_a_view_without_depth_is_skipped_by_what_needs_it(bench, dive: Path):
    (dive / "depths" / "depth_b.png").unlink()
    done = run(bench, dive, METHODS)
    assert "skipped  colmap / stitching / b.png: " in done.stdout
    assert "5 ok, 0 failed, 1 skipped" in done.stdout


def test_other_data_do_not_take_over_an_output_folder(bench, dive: Path, tmp_path: Path):
    run(bench, dive)
    other = write_dive(tmp_path / "other", NAMES)
    done = run(bench, other)
    assert done.returncode == 2
    assert re.search(r"'colmap'.* out=.* dataset\.label=", done.stderr)
    assert set(results.read(tmp_path / "results")["scene"]) == {"dive"}


def test_a_folder_with_an_unusual_name_works_quoted_and_the_remedy_says_so(
    bench, tmp_path: Path
):
    dive = write_dive(tmp_path / "dive ünï=1,[x]", NAMES)
    assert f"write \"dataset.root='{dive}'\"" in run(bench, dive).stderr
    assert run(bench, f"'{dive}'").returncode == 0


GOLDEN = Path(__file__).with_name("golden_errors")
MISTAKES = {
    "run": ["method=grey_world"],
    "compare": ["nowhere"],
    "score": [".", "--metrics", "uicqe"],
    "prepare": ["nowhere", "out"],
    "restore": ["nowhere", "out"],
    "describe": ["dataset=colmap", "dataset.root=nowhere"],
    "charts": ["dataset=demo", "--kind", "dkg"],
    "report": ["nowhere"],
    "track": ["nowhere"],
    "bundle": ["nowhere", "paper.zip"],
    "verify": ["nowhere.zip"],
    "study": ["nowhere", "--methods", "sucre,gray_world", "--out", "study.html"],
    "list": ["plugins"],
    "new": ["method", "my-method"],
    "check": ["gray_wrld"],
    "doctor": ["--jsn"],
    "completion": ["powershell"],
}


def test_every_command_has_a_mistake() -> None:
    assert set(MISTAKES) == set(commands())


@pytest.mark.parametrize("command", MISTAKES)
def test_a_mistake_is_answered_in_one_line_on_stderr(
    command: str, bench: Callable[..., Done]
) -> None:
    done = bench(command, *MISTAKES[command])
    file = GOLDEN / f"{command}.txt"
    # not of every plugin
    said = re.sub(
        r"; known: .*|(did you mean '\w+')\? known: (?:\w+, ){9}.*", r"\1", done.stderr
    )
    if os.environ.get("GOLDEN") == "write":
        file.write_text(said, encoding="utf-8")
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.errors) == 1
    assert said == file.read_text(encoding="utf-8")
