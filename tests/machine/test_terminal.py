"""What a terminal, a pipe and a program each get: help that fits, escape codes or none, JSON, exit codes."""

from __future__ import annotations

import json
import os
import pty
import re
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from sucre_bench.cli import cli
from sucre_bench.jobs import command as config
from sucre_bench.machine import provenance
from sucre_bench.programs import doctor

PROGRAM = str(Path(sys.executable).with_name("sucre-bench"))
ESCAPE, COLOUR = "\x1b[", re.compile(r"\x1b\[(?:\d+;)*3\d")


def in_terminal(*arguments: str, folder: Path, **environment: str) -> str:
    """What a real terminal gets to see."""
    parent, child = pty.openpty()
    unset = ("NO_COLOR", "FORCE_COLOR", "TERM", "COLORTERM")
    env = {k: v for k, v in os.environ.items() if k not in unset} | {"TERM": "xterm-256color"} | environment
    with subprocess.Popen([PROGRAM, *arguments], stdout=child, stderr=child, stdin=child, cwd=folder, env=env):
        os.close(child)
        said = b""
        while True:
            try:
                chunk = os.read(parent, 65536)
            except OSError:  # how Linux says that the other end has closed
                break
            if not chunk:
                break
            said += chunk
    os.close(parent)
    return said.decode()


def helps() -> list[tuple[str, click.Command]]:
    return [("", cli), *cli.commands.items()]


@pytest.mark.parametrize("width", [80, 120])
@pytest.mark.parametrize(("name", "command"), helps(), ids=lambda value: value if isinstance(value, str) else "")
def test_help_fits_the_terminal(name: str, command: click.Command, width: int):
    said = CliRunner().invoke(cli, [*([name] if name else []), "--help"], terminal_width=width).output
    assert not [line for line in said.splitlines() if len(line) > width]
    assert said.startswith("Usage: ")


@pytest.mark.parametrize(("name", "command"), helps(), ids=lambda value: value if isinstance(value, str) else "")
def test_help_begins_with_examples_that_name_real_options(name: str, command: click.Command):
    text = command.help or ""
    lines = [line.strip() for line in text.split("\b")[1].split("\n\n")[0].splitlines()]
    examples = [line for line in lines if line.startswith("sucre-bench ")]
    assert examples or name == "completion"
    assert text.index("\b") < 200, "the examples come after the first sentence"
    for line in examples:
        words = shlex.split(re.split(r"\s{3,}| \| | > ", line)[0])[1:]
        own = cli.commands[words[0]]
        known = {option for p in own.params for option in (*p.opts, *p.secondary_opts)}
        assert {word for word in words[1:] if word.startswith("-")} <= known
        if words[0] == "run":
            assert config.jobs([w for w in words[1:] if not w.startswith("-")], multirun="-m" in words).jobs


def test_every_command_has_its_place_in_the_help():
    listed = [name for names in type(cli).sections.values() for name in names]  # type: ignore[attr-defined]
    assert sorted(listed) == sorted(cli.commands)


def test_colours_are_for_terminals_and_no_color_takes_them_away(bench, tmp_path: Path):
    assert COLOUR.search(in_terminal("doctor", folder=tmp_path))
    assert not COLOUR.search(in_terminal("doctor", folder=tmp_path, NO_COLOR="1"))
    assert ESCAPE not in in_terminal("doctor", folder=tmp_path, TERM="dumb")
    assert ESCAPE not in bench("doctor", FORCE_COLOR="").stdout


def test_force_color_colours_a_log_but_draws_no_bars(bench, toys: str):
    done = bench("run", "--plugin", toys, "dataset=toy", "method=faulty", "metrics=[redness]", "tracking.uri=off",
                 "report=false", FORCE_COLOR="1")  # fmt: skip
    assert COLOUR.search(done.stdout)
    assert "\r" not in done.stderr
    assert "\x1b[?25l" not in done.stderr  # how a bar hides the cursor
    assert ESCAPE in bench("list", "methods", FORCE_COLOR="1").stdout


@pytest.mark.parametrize("command", ["list methods", "list metrics --json", "run --help", "doctor", "run --cfg"])
def test_a_reader_that_has_enough_is_no_fault(command: str, tmp_path: Path):
    """As `| head -1`; here the reader is gone before anything is written."""
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [PROGRAM, *command.split()], stdout=writing, stderr=subprocess.PIPE, text=True, check=False, cwd=tmp_path
    )
    os.close(writing)
    assert done.stderr == ""
    assert done.returncode in (1, 141)


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
    bench("run", "--plugin", toys, "dataset=toy", "method=gain", "metrics=[redness]", "tracking.uri=off", "out=results")
    by_name = bench("compare", "results", "--json").stdout
    assert json.loads(by_name)
    assert by_name == bench("compare", "results", "--format", "json").stdout
    scored = bench("score", "results/restored/toy/gain", "--metrics", "uciqe", "--json").stdout
    assert {row["metric"] for row in json.loads(scored)} >= {"uciqe"}
    for command in ("run", "compare", "score", "list", "describe", "check", "doctor"):
        assert "--json" in {name for p in cli.commands[command].params for name in p.opts}, command


# -- doctor --------------------------------------------------------------------------------------------------


def states(found: doctor.Examined) -> dict[str, doctor.Feature]:
    return {feature.name: feature for feature in found.features}


def test_doctor_tells_programs_what_people_read(bench):
    done = bench("doctor", "--json")
    told = json.loads(done.stdout)
    assert done.returncode == (1 if told["faults"] else 0)
    assert set(told["machine"]) >= {"cores", "memory", "disk", "gpu"}
    for feature in told["features"]:
        assert feature["said"]
        assert feature["state"] in ("ready", "missing", "broken", "absent")
        if feature["state"] == "missing":
            assert re.search(r"pip install \S+|apt-get install \S+|make setup", feature["remedy"])


def test_doctor_counts_a_missing_dependency_but_nothing_optional(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    version_of = provenance.version_of
    monkeypatch.setattr(provenance, "version_of", lambda name: None if name == "pycolmap" else version_of(name))
    monkeypatch.setattr(doctor.shutil, "which", lambda program: None)
    monkeypatch.setattr(doctor, "_open3d_fault", lambda: ("", ""))
    found = doctor.examine(tmp_path / "not" / "there")
    assert found.faults == 1
    lacking = states(found)["prepare: photos to a scene"]
    assert (lacking.state, lacking.remedy.split("-m ")[1]) == ("broken", "pip install pycolmap")
    assert states(found)["tests in a browser"].state == "missing"
    assert states(found)["a cluster, by SLURM"].state == "absent"


def test_doctor_sees_a_torch_that_cannot_use_the_gpu(monkeypatch: pytest.MonkeyPatch):
    version_of = provenance.version_of
    monkeypatch.setattr(provenance, "gpu", lambda: "NVIDIA H100")
    monkeypatch.setattr(doctor, "_open3d_fault", lambda: ("", ""))
    for torch, said in (("2.6.0+cpu", "built for CPUs alone"), ("2.6.0+cu124", "does not see the NVIDIA H100")):
        monkeypatch.setattr(provenance, "version_of", lambda n, t=torch: t if n == "torch" else version_of(n))
        failed = subprocess.CompletedProcess([], 1, "", "Traceback\nRuntimeError: driver too old")
        monkeypatch.setattr(doctor, "_python", lambda code, failed=failed: failed)
        feature = states(doctor.examine())["SUCRe on the GPU"]
        assert feature.state == "broken"
        assert said in feature.said
