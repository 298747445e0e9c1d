"""What --json tells a program."""

from __future__ import annotations

import json
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from support.command_line import commands

from sucre_bench.cli import SECTIONS, cli


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
        assert "--json" in {name for p in commands()[command].params for name in p.opts}, (
            command
        )


def test_check_tells_a_program_what_a_plugin_breaks(bench, tmp_path: Path):
    (tmp_path / "half.py").write_text(
        "from dataclasses import dataclass\nfrom sucre_bench import Restoration, method\n\n\n@method()\n"
        "@dataclass(frozen=True)\nclass Half:\n    def restore(self, scene, view):\n"
        "        return Restoration(view.rgb[::2])\n"
    )
    done = bench("check", "half.py", "--quick", "--json")
    (told,) = json.loads(done.stdout)
    assert (told["ok"], done.returncode) == (False, 1)
    broken = {rule["name"]: rule["findings"] for rule in told["rules"] if rule["findings"]}
    assert "(64, 96, 3)" in broken["restores_a_view"][0]["text"]


def helps() -> list[tuple[str, click.Command]]:
    return [("", cli), *commands().items()]


@pytest.mark.parametrize("width", [80, 120])
@pytest.mark.parametrize("name", [name for name, _ in helps()])
def test_help_fits_the_terminal(name: str, width: int):
    words = [name, "--help"] if name else ["--help"]
    said = CliRunner().invoke(cli, words, terminal_width=width).output
    assert not [line for line in said.splitlines() if len(line) > width]
    assert said.startswith("Usage: ")


def test_every_command_has_its_place_in_the_help():
    listed = [name for names in SECTIONS.values() for name in names]
    assert sorted(listed) == sorted(commands())
