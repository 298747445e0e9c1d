"""Commands that are told to write over something: what is there stays as it is."""

import os
import re
import shlex
import shutil
import stat
from pathlib import Path

import pytest
from support.colmap_folder import write_dive
from support.command_line import run_here

from sucre_bench.errors import OutputError
from sucre_bench.machine.files import write_atomically

# A command, the file that must stay as it is, a word of the fault, and what to do.
CASES: dict[str, tuple[str, str, str]] = {
    "scores over a photograph": (
        "score dive/images --metrics uciqe --csv dive/images/a.png",
        "dive/images/a.png",
        r"suffix.*\.csv",
    ),
    "scores over the published table": (
        "score dive/images --like published.csv --csv published.csv",
        "published.csv",
        "input.*another file",
    ),
    "scores into a pipe": (
        "score dive/images --metrics uciqe --csv pipe.csv",
        "pipe.csv",
        "pipe.*another file",
    ),
    "a study over the score table": (
        "study results --methods gray_world,clahe --out results/scores.parquet",
        "results/scores.parquet",
        r"suffix.*\.html",
    ),
    "a study over the report": (
        "study results --methods gray_world,clahe --out results/report/index.html",
        "results/report/index.html",
        "exists.*--force",
    ),
    "a contact sheet over a view": (
        "describe colmap dataset.root=dive --sheet dive/images/a.png --force",
        "dive/images/a.png",
        "input.*another file",
    ),
    "scores over a table of others": (
        "score dive/images --metrics uciqe --csv theirs.csv",
        "theirs.csv",
        "exists",
    ),
    "a study over a page of others": (
        "study results --methods gray_world,clahe --out theirs.html",
        "theirs.html",
        "exists.*--force",
    ),
    "a contact sheet over a photograph of others": (
        "describe colmap dataset.root=dive --sheet theirs.png",
        "theirs.png",
        "exists",
    ),
    "a bundle over an archive of others": ("bundle results theirs.zip", "theirs.zip", "exists"),
    "results over the files of a project": (
        "run dataset=colmap dataset.root=dive method=clahe out=project",
        "project/config.yaml",
        "without results.*out=",
    ),
    "pictures over the photographs": (
        "restore dive/images dive/images",
        "dive/images",
        "photographs",
    ),
    "pictures among the photographs": (
        "restore dive/images dive/images/restored",
        "dive/images/restored",
        "photographs",
    ),
    "pictures over an album": ("restore dive/images album", "album", "other files"),
    "pictures beside a thesis": ("restore dive/images mine", "mine", "other files"),
    "pictures where a link leads": (
        "restore dive/images linked",
        "linked/pictures",
        "leads out of the folder;",
    ),
    "a scene over a project": ("prepare dive/images project", "project", "other files"),
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dive, a run of it with its page, a bundle and a published table."""
    place = tmp_path_factory.mktemp("made")
    write_dive(place / "dive")
    words = "dataset=colmap dataset.root=dive method=gray_world,clahe metrics=[uciqe] tracking.uri=off out=results"
    assert run_here(place, "run", "-m", *words.split()).returncode == 0
    (place / "bundles").mkdir()
    assert run_here(place, "bundle", "results", "bundles/one.zip").returncode == 0
    (place / "published.csv").write_text("image,uciqe\na.png,0.5\nb.png,0.6\n")
    others = [f"theirs.{suffix}" for suffix in ("csv", "html", "yaml", "png", "zip")]
    others += [
        "project/config.yaml",
        "album/pictures/a.png",
        "album/work/a.txt",
        "mine/work/thesis.txt",
    ]
    for name in (*others, "linked/work/restore.json"):
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_text("years of work\n")
    (place / "linked/pictures").symlink_to("../album/pictures")
    return place


@pytest.fixture
def place(made: Path, tmp_path: Path) -> Path:
    folder = tmp_path / "here"
    shutil.copytree(made, folder, symlinks=True)
    os.mkfifo(folder / "pipe.csv")
    return folder


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_an_output_that_would_destroy_something_is_refused(
    place: Path, case: tuple[str, str, str]
):
    command, target, said = case
    before = _state(place / target)
    done = run_here(place, *shlex.split(command))
    assert done.returncode == 2, done.stdout
    (line,) = done.errors
    assert re.search(rf"^error: {re.escape(target)}: .*{said}", line), line
    assert _state(place / target) == before


def _state(path: Path) -> list[tuple[Path, int, int, bytes]]:
    """What a file is, or a folder and all in it."""
    every = [path, *sorted(path.rglob("*"))] if os.path.lexists(path) else []
    return [
        (p, p.lstat().st_mode, p.lstat().st_ino, p.read_bytes() if p.is_file() else b"")
        for p in every
    ]


def test_force_writes_over_a_file_of_others(place: Path):
    done = run_here(
        place, "score", "dive/images", "--metrics", "uciqe", "--csv", "theirs.csv", "--force"
    )
    assert done.returncode == 0
    assert (place / "theirs.csv").read_text().startswith("dataset,")


@pytest.mark.parametrize(
    "command",
    ["report results", "run dataset=colmap dataset.root=dive method=clahe out=results"],
)
def test_nothing_is_written_where_a_link_leads_out_of_the_results(place: Path, command: str):
    (place / "results/report").rename(place / "elsewhere")
    (place / "results/report").symlink_to("../elsewhere")
    before = _state(place / "elsewhere/index.html")
    done = run_here(place, *command.split())
    assert done.returncode == 2
    assert "results/report: leads out of the folder; " in done.stderr
    assert _state(place / "elsewhere/index.html") == before


def test_what_is_no_file_is_not_replaced_by_one(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OutputError, match=r"pipe: .*no file; "):
        write_atomically(tmp_path / "pipe", b"text")
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)
