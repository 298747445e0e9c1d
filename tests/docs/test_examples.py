"""The example of a package of others: installed as it is, outside the repository, and used from there."""

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from support.command_line import install
from support.places import ROOT

EXAMPLE = ROOT / "examples" / "colour-extras"
Bench = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture(scope="module")
def copied(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of its source: installing leaves files there."""
    return shutil.copytree(EXAMPLE, tmp_path_factory.mktemp("source") / EXAMPLE.name)


@pytest.fixture(scope="module")
def installed(copied: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The folder it is installed in."""
    target = tmp_path_factory.mktemp("installed")
    install(copied, target)
    return str(target)


def test_all_that_it_brings_is_run_together_with_what_is_built_in(
    program: Bench, installed: str, tmp_path: Path
):
    job = [
        "dataset=ramp",
        "method=underwater,white_patch",
        "metrics=[psnr,colourfulness]",
        "out=results",
    ]
    done = program("run", "-m", *job, "tracking.uri=off", "report=false", PYTHONPATH=installed)
    assert done.returncode == 0, done.stderr
    assert "8 ok, 0 failed, 0 skipped" in done.stdout
    assert (tmp_path / "results" / "restored" / "ramp" / "white_patch").is_dir()


def test_its_own_tests_pass(copied: Path, installed: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:dash", str(copied / "tests")],
        cwd=copied,
        env={"PATH": "", "PYTHONPATH": installed},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    assert "6 passed" in done.stdout
