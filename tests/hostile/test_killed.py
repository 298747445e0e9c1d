"""Commands that are killed again and again: the same command then gives what it gives undisturbed.

Each is killed before some of its changes of files, drawn at random; `make fuzz` draws more.
"""

import hashlib
import os
import pty
import random
import select
import shutil
import signal
import sqlite3
import sys
import time
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
import pytest
from support.command_line import PROGRAM, Started, but_times, run_here
from support.photographed_valley import POSES, photograph, write
from support.places import TOYS

from sucre_bench import results

KILLS = int(os.environ.get("FUZZ_KILLS", "0"))
SEED = int(os.environ.get("FUZZ_SEED", "0"))
RUN = [
    "run",
    "-m",
    "--plugin",
    str(TOYS),
    "dataset=toy",
    "method=gain,faulty",
    "metrics=[psnr,redness]",
]
RUN += ["tracking.uri=off", "report=false", "out=results"]


def rows_and_pictures(folder: Path) -> Any:
    """The score table without what differs from run to run, and the pictures."""
    pictures = {
        str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*.png")
    }
    return but_times(results.read(folder / "results")).to_csv(index=False), pictures


def page(folder: Path) -> Any:
    return (folder / "results" / "report" / "index.html").read_text(encoding="utf-8")


def bundled(folder: Path) -> Any:
    with zipfile.ZipFile(folder / "b.zip") as file:
        return {info.filename: info.CRC for info in file.infolist()}


def tracked(folder: Path) -> Any:
    """The runs, how they ended, and their numbers."""
    with sqlite3.connect(folder / "mlflow.db") as store:
        runs = store.execute("SELECT name, status FROM runs ORDER BY 1").fetchall()
        numbers = "SELECT name, m.key, m.value FROM runs JOIN latest_metrics m ON m.run_uuid = runs.run_uuid"
        return runs, sorted(store.execute(numbers).fetchall())


def prepared(folder: Path) -> Any:
    files = sorted(
        path for name in ("images", "sparse") for path in (folder / "out" / name).rglob("*.*")
    )
    depths = [path.name for path in sorted((folder / "out" / "depths").iterdir())]
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in files
    }, depths


@dataclass(frozen=True)
class Case:
    """A command, what is compared of what it leaves, its exit code.

    needs: what lies in the folder before; kills: how often it is killed; `make fuzz` asks for more.
    """

    words: list[str]
    made: Callable[[Path], Any]
    needs: str = "results"
    status: int = 0
    kills: int = 2


CASES = {
    "run": Case(RUN, rows_and_pictures, "", 1, kills=3),
    "report": Case(["report", "results"], page),
    "bundle": Case(["bundle", "results", "b.zip"], bundled),
    "track": Case(["track", "results", "--uri", "sqlite:///mlflow.db"], tracked, kills=0),
    "prepare": Case(
        ["prepare", "photos", "out", "--scale", "2", "--surface", "sparse"],
        prepared,
        "photos",
        kills=0,
    ),
}


@pytest.fixture(scope="module")
def before(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the commands need."""
    folder = tmp_path_factory.mktemp("before")
    (folder / "none").mkdir()
    assert run_here(folder / "none", *RUN).returncode == 1
    (folder / "none" / "results").rename(folder / "results")
    for number, pose in enumerate(POSES[:4]):
        write(folder / "photos" / f"{number}.png", photograph(pose))
    return folder


def killed_at(moment: int, folder: Path, words: list[str]) -> int:
    """How a command ended that is killed before a change of files, where it makes as many."""
    return Started(folder, *words, dies_at=moment).ended().returncode


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if KILLS or case.kills])
def test_a_command_that_was_killed_gives_what_it_gives_undisturbed(
    before: Path, tmp_path: Path, name: str
):
    case = CASES[name]
    for place in ("undisturbed", "killed"):
        (tmp_path / place).mkdir()
        if case.needs:
            shutil.copytree(before / case.needs, tmp_path / place / case.needs)
    alone = Started(tmp_path / "undisturbed", *case.words)
    done = alone.ended()
    assert done.returncode == case.status, done.stderr
    draw = random.Random(f"{SEED} {name}")
    moments = [draw.randint(1, alone.changes) for _ in range(KILLS or case.kills)]
    # The number of changes differs: quick machines write rows together, and some rows are there already.
    ends = [killed_at(moment, tmp_path / "killed", case.words) for moment in moments]
    assert (
        -signal.SIGKILL in ends
        or killed_at(1, tmp_path / "killed", case.words) == -signal.SIGKILL
    )
    again = Started(tmp_path / "killed", *case.words).ended()
    assert again.returncode == done.returncode, again.stderr
    assert case.made(tmp_path / "killed") == case.made(tmp_path / "undisturbed")


def test_what_a_killed_process_was_writing_is_no_result(before: Path, tmp_path: Path):
    shutil.copytree(before / "results", tmp_path / "results")
    left = [
        tmp_path / "results" / place / ".writing-abc"
        for place in ("", "parts", "restored/toy/gain", "report")
    ]
    for path in left:
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"half a file")
    assert run_here(tmp_path, *RUN).returncode == 1
    assert run_here(tmp_path, "bundle", "results", "b.zip", "--pictures", "all").returncode == 0
    assert not [name for name in bundled(tmp_path) if ".writing" in name]
    assert all(path.exists() for path in left)  # another process may be at it


SLEEPING = "import os, pathlib, sys, time; pathlib.Path(sys.argv[1]).write_text(str(os.getpid())); time.sleep(600)"


@pytest.mark.parametrize("end", ["the terminal closes", "the command is killed"])
def test_no_program_of_a_method_lives_longer_than_the_command(tmp_path: Path, end: str):
    (tmp_path / "sleeping.py").write_text(SLEEPING)
    told = tmp_path / "pid"
    program = (
        f"method.run='{sys.executable} -S {tmp_path}/sleeping.py {told} {{input}} {{output}}'"
    )
    started, terminal = pty.fork()
    if not started:
        os.chdir(tmp_path)
        words = [
            "run",
            "--plugin",
            str(TOYS),
            "dataset=acts",
            "method=command",
            program,
            "metrics=[coverage]",
        ]
        signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored below `nohup make test`
        os.execv(PROGRAM, [PROGRAM, *words, "tracking.uri=off", "report=false"])
    try:
        deadline = time.monotonic() + 300
        while not (told.exists() and told.read_text()) and time.monotonic() < deadline:
            if select.select([terminal], [], [], 0.02)[0]:
                os.read(terminal, 1 << 16)
        of_method = psutil.Process(int(told.read_text()))
        if end == "the command is killed":
            os.kill(started, signal.SIGKILL)
    finally:
        os.close(terminal)
    _, status = os.waitpid(started, 0)
    assert os.waitstatus_to_exitcode(status) == (
        130 if end == "the terminal closes" else -signal.SIGKILL
    )
    of_method.wait(300)
