"""What `sucre-bench new` writes works as it is, wherever it is written, and nothing is lost by it."""

import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from support.colmap_folder import write_image
from support.messages import names
from support.places import ROOT

from sucre_bench import plugins
from sucre_bench.cli import cli
from sucre_bench.commands.extend import new as command

Bench = Callable[..., "subprocess.CompletedProcess[str]"]
KINDS = [("method", ()), ("method", ("--depth",)), ("metric", ()), ("dataset", ())]


def new(*arguments: str) -> Result:
    return CliRunner().invoke(command, arguments)


def pytest_in(folder: Path, *arguments: str, **environment: str) -> str:
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:dash", "-W", "error", *arguments]
    env = {"PATH": "", **environment}
    done = subprocess.run(
        command, cwd=folder, env=env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout
    return done.stdout


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that commands are given in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def checkout(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the engine with one plugin a kind, to write into."""
    for kind in plugins.KINDS:
        (folder / f"{kind}s").mkdir()
        shutil.copy(ROOT / f"{kind}s" / "__init__.py", folder / f"{kind}s")
    (folder / "tests").mkdir()
    kept = shutil.ignore_patterns("methods", "datasets", "metrics")
    shutil.copytree(ROOT / "sucre_bench", folder / "sucre_bench", ignore=kept)
    for kind in plugins.KINDS:
        (folder / "sucre_bench" / f"{kind}s").symlink_to(Path("..") / f"{kind}s")
    return folder


def test_files_in_a_folder_pass_their_tests_as_they_are(folder: Path) -> None:
    for number, (kind, more) in enumerate(KINDS):
        done = new(kind, f"tried_{number}", *more)
        assert done.exit_code == 0, done.output
        assert done.stdout.splitlines()[:2] == [
            f"wrote    tried_{number}.py",
            f"wrote    test_tried_{number}.py",
        ]
    assert "11 passed" in pytest_in(folder)


def test_files_in_a_checkout_go_where_they_belong_and_pass_their_tests(checkout: Path) -> None:
    """Also with names whose classes would hide those that the files import, or words of Python's."""
    for name, (kind, more) in zip(("restoration", "view", "score", "true"), KINDS, strict=True):
        done = new(kind, name, *more)
        assert done.exit_code == 0, done.output
        assert (checkout / f"{kind}s" / f"{name}.py").is_file()
        assert (checkout / "tests" / f"{kind}s" / f"test_{name}.py").is_file()
    assert "7 passed" in pytest_in(checkout, PYTHONPATH=str(checkout))


def test_the_commands_it_names_are_those_that_work(folder: Path) -> None:
    for name in "ab":
        write_image(
            folder / "dive" / "images" / f"{name}.png", np.full((30, 40, 3), 90, np.uint8)
        )
    for kind in plugins.KINDS:
        lines = dict(
            line.split(maxsplit=1)
            for line in new(kind, f"tried_{kind}").stdout.splitlines()[2:]
        )
        assert list(lines) == ["check", "test", "run"]
        for line, more in ((lines["run"], "--cfg"), (lines["check"], "--quick")):
            done = CliRunner().invoke(
                cli, [*shlex.split(line.replace("=DIR", "=dive"))[1:], more]
            )
            assert done.exit_code == 0, done.output
            assert " kept" in done.stdout or more == "--cfg"


@pytest.mark.parametrize(
    ("kind", "name", "named"),
    [
        ("method", "gray_world", "method"),
        ("method", "MyMethod", "my_method"),
        ("method", "my-method", "my_method"),
        ("metric", "3d", "my_metric"),
        ("dataset", "class", "my_class"),
        ("method", "numpy", "my_numpy"),
    ],
)
def test_names_that_cannot_be_are_refused(
    folder: Path, kind: str, name: str, named: str
) -> None:
    assert {name, named} <= names(new(kind, name).exception)
    assert not list(folder.iterdir())


def test_nothing_is_overwritten_and_nothing_half_written(folder: Path) -> None:
    (folder / "test_tried.py").write_text("mine")
    assert "test_tried.py: " in str(new("method", "tried").exception)
    assert [path.name for path in folder.iterdir()] == ["test_tried.py"]
    assert (folder / "test_tried.py").read_text() == "mine"
