"""What --json tells a program."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from support.colmap_folder import write_dive
from support.command_line import commands
from support.places import write_experiments

from sucre_bench.cli import SECTIONS, cli
from sucre_bench.jobs import compose_jobs as config


def test_run_tells_a_program_all_in_one_object(bench, toys: str, tmp_path: Path):
    """Although a method of theirs prints."""
    (tmp_path / "loud.py").write_text(
        "from dataclasses import dataclass\nfrom sucre_bench import Restoration, method\n\n\n@method()\n"
        "@dataclass(frozen=True)\nclass Loud:\n    def restore(self, scene, view):\n        print('hello')\n"
        "        return Restoration(view.rgb)\n"
    )
    done = bench("run", "--json", "-m", "--plugin", toys, "--plugin", "loud.py", "dataset=toy", "method=loud,faulty",
                 "metrics=[redness]", "tracking.uri=off", "out=results")  # fmt: skip
    told = json.loads(done.stdout)
    assert (told["ok"], told["exit_code"], done.returncode) == (5, 1, 1)
    (fault,) = told["failed"]
    assert (fault["where"], fault["view"]) == ("toy / faulty", "v1.png")
    assert "boom" in fault["reason"]
    for name in ("table", "page", "log"):
        assert (tmp_path / told[name]).is_file()
    assert "hello" in done.stderr


def test_json_is_asked_for_alike(bench, toys: str):
    bench("run", "--plugin", toys, "dataset=toy", "method=gain", "metrics=[redness]", "tracking.uri=off", "out=results",
          "workers=0", "report=false")  # fmt: skip
    by_name = bench("compare", "results", "--json").stdout
    assert json.loads(by_name)
    assert by_name == bench("compare", "results", "--format", "json").stdout
    scored = bench("score", "results/restored/toy/gain", "--metrics", "uciqe", "--json").stdout
    assert {row["metric"] for row in json.loads(scored)} >= {"uciqe"}
    for command in ("run", "compare", "score", "list", "describe", "check", "doctor"):
        assert "--json" in {name for p in commands()[command].params for name in p.opts}, command


@pytest.fixture(scope="module")
def examples_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files that the examples name."""
    folder = tmp_path_factory.mktemp("examples")
    write_experiments(folder)
    write_dive(folder / "dive")
    return folder


def helps() -> list[tuple[str, click.Command]]:
    return [("", cli), *commands().items()]


@pytest.mark.parametrize("width", [80, 120])
@pytest.mark.parametrize(
    ("name", "command"), helps(), ids=lambda value: value if isinstance(value, str) else ""
)
def test_help_fits_the_terminal(name: str, command: click.Command, width: int):
    said = (
        CliRunner().invoke(cli, [*([name] if name else []), "--help"], terminal_width=width).output
    )
    assert not [line for line in said.splitlines() if len(line) > width]
    assert said.startswith("Usage: ")


@pytest.mark.parametrize(
    ("name", "command"), helps(), ids=lambda value: value if isinstance(value, str) else ""
)
def test_help_begins_with_examples_that_name_real_options(
    name: str, command: click.Command, examples_folder: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(examples_folder)
    text = command.help or ""
    lines = [line.strip() for line in text.split("\b")[1].split("\n\n")[0].splitlines()]
    examples = [line for line in lines if line.startswith("sucre-bench ")]
    assert examples or name == "completion"
    assert text.index("\b") < 200, "the examples come after the first sentence"
    for line in examples:
        words = shlex.split(re.split(r"\s{3,}| \| | > ", line)[0])[1:]
        own = commands()[words[0]]
        known = {option for p in own.params for option in (*p.opts, *p.secondary_opts)}
        assert {word for word in words[1:] if word.startswith("-")} <= known
        if words[0] == "run" and "--config-dir" not in words:
            overrides = [word for word in words[1:] if not word.startswith("-")]
            if any(word.startswith("experiment=") for word in words):
                overrides.append("method=gray_world")  # tests/golden composes all its methods
            assert config.jobs(overrides, multirun="-m" in words).jobs


def test_every_command_has_its_place_in_the_help():
    listed = [name for names in SECTIONS.values() for name in names]
    assert sorted(listed) == sorted(commands())
