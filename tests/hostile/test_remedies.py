"""Remedies are executed: from each fault, what its message names is done, and the work goes on."""

import re
import shlex
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from support.colmap_folder import write_dive, write_image
from support.command_line import Done, run_here, succeeded

RUN = "run dataset=colmap dataset.root=dive tracking.uri=off report=false out=results"
GRAY = "method=gray_world metrics=[coverage]"
RESULTS = r"give the folder that `sucre-bench run (out=)\.\.\.` wrote"


@dataclass(frozen=True)
class Case:
    """A command that fails; a pattern of the remedy that it names; the commands that follow it, of which all succeed.

    In these, {1} stands for the pattern's first group. spoil: changes the folder before the command.
    """

    fault: str
    remedy: str
    then: tuple[str, ...]
    spoil: Callable[[Path], object] = lambda folder: None
    status: int = 2


def small_restorations(folder: Path) -> None:
    for name in ("a.png", "b.png"):
        write_image(folder / "restored" / name, np.full((15, 20, 3), 99, np.uint8))


def damaged_table(folder: Path) -> None:
    (folder / "done" / "scores.parquet").write_bytes(b"x")


PRECOMPUTED = f"{RUN} method=precomputed method.folder=restored metrics=[coverage]"
CASES = {
    "a mistyped command": Case(
        f"rn {GRAY}", r"did you mean '(run)'", (f"{RUN.replace('run ', '{1} ')} {GRAY}",)
    ),
    "an option of a method among those of run": Case(
        f"{RUN} {GRAY} display=none",
        r"write (gray_world\.display=none)",
        (f"{RUN} {GRAY} {{1}}",),
    ),
    "a mistyped view": Case(
        f"{RUN} {GRAY} views=[aa.png]",
        r"did you mean '(.*?)'",
        (f"{RUN} {GRAY} views=[{{1}}]",),
    ),
    "a word without =": Case(
        f"{RUN} metrics=[coverage] gray_world",
        r"write (method=)NAME",
        (f"{RUN} metrics=[coverage] {{1}}gray_world",),
    ),
    "no metric": Case(
        f"{RUN} method=gray_world metrics=[]",
        r"add metrics=\[NAME,\.\.\.\], `sucre-bench (list metrics)`",
        ("{1}", f"{RUN} {GRAY}"),
    ),
    "a shard that is none": Case(
        f"{RUN} {GRAY} shard.count=2 shard.index=2",
        r"run (-m) (shard.count=8) '(shard.index=.*?)'",
        (f"{RUN} {GRAY} {{1}} {{2}} {{3}}",),
    ),
    "other options under one label": Case(
        f"{RUN} {GRAY} method.display=white-99 out=done",
        r"give another (method\.label)=\.\.\., or (overwrite=always)",
        (
            f"{RUN} {GRAY} method.display=white-99 out=done {{1}}=new",
            f"{RUN} {GRAY} method.display=white-99 out=done {{2}}",
        ),
    ),
    "restorations of another size": Case(
        PRECOMPUTED,
        r"or give (method\.resize=true)",
        (f"{PRECOMPUTED} {{1}}",),
        small_restorations,
        1,
    ),
    "a damaged table": Case(
        "compare done",
        r"; .*delete",
        (f"{RUN} {GRAY} out=fresh", "compare fresh"),
        damaged_table,
    ),
    "no results to compare": Case(
        "compare results", RESULTS, (f"{RUN} {GRAY} {{1}}results", "compare results")
    ),
    "no bundle": Case(
        "verify b.zip", r"`sucre-bench (bundle)` wrote", ("{1} done b.zip", "verify b.zip")
    ),
    "a bundle of another suffix": Case(
        "bundle done b.txt", r"; .*(\.zip)", ("bundle done b{1}",)
    ),
    "a limit without a baseline": Case(
        "compare done --fail-below coverage=-0.5",
        r"needs (--baseline) METHOD",
        ("compare done --fail-below coverage=-0.5 {1} gray_world",),
    ),
    "a mistyped limit": Case(
        "compare done --baseline gray_world --fail-below nonsense",
        r"write METRIC=NUMBER",
        ("compare done --baseline gray_world --fail-below coverage=-1",),
    ),
    "a metric without scores": Case(
        "compare done --metric nope", r"known: (\w+)", ("compare done --metric {1}",)
    ),
    "a study of one method": Case(
        "study done --methods gray_world --out a.html",
        r"--methods.*two",
        ("study done --methods gray_world,underwater --out a.html",),
    ),
    "a method without pictures": Case(
        "study done --methods gray_world,nope --out a.html",
        r"known: (\w+), (\w+)",
        ("study done --methods {1},{2} --out a.html",),
    ),
    "a folder that is nowhere": Case(
        f"{RUN} {GRAY} dataset.root=nowhere",
        r"as (dataset\.root=)DIR",
        (f"{RUN} {GRAY} {{1}}dive",),
    ),
    "a plugin's name in capitals": Case("new method Mine", r"; .* (\w+)$", ("new method {1}",)),
}


@pytest.fixture(scope="module")
def before(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dive, and a results folder of it."""
    folder = tmp_path_factory.mktemp("before")
    write_dive(folder / "dive", ("a.png", "b.png"))
    words = f"{RUN} -m method=gray_world,underwater metrics=[coverage] out=done"
    succeeded(folder, *words.split())
    return folder


@pytest.mark.parametrize("name", CASES)
def test_a_remedy_works_from_its_fault_on(before: Path, tmp_path: Path, name: str):
    case, folder = CASES[name], tmp_path / "place"
    shutil.copytree(before, folder)
    case.spoil(folder)
    done = command(folder, case.fault)
    assert done.returncode == case.status, done.stderr
    found = re.search(case.remedy, done.stderr)
    assert found, done.stderr
    for words in case.then:
        done = command(folder, words.format(found[0], *found.groups()))
        assert done.returncode == 0, f"{words}: {done.stderr}"


def command(folder: Path, words: str) -> Done:
    return run_here(folder, *shlex.split(words.removeprefix("sucre-bench ")))
