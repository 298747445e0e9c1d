"""The command line as a user meets it: what it says, where, and its exit codes."""

import errno
import json
import re
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import pytest
from support.command_line import HEAVY

from sucre_bench.commands.completion import completion
from sucre_bench.errors import Lack


def test_help_and_lists_import_nothing_heavy():
    code = (
        "import sys\nfrom sucre_bench.cli import cli\n"
        "for words in ('--help', 'list methods', 'list metrics --json', 'run -h', 'prepare -h'):\n"
        "    cli(words.split(), standalone_mode=False)\n"
        "print('\\nIMPORTED', *sorted({m.split('.')[0] for m in sys.modules}))"
    )
    said = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    imported = set(said.splitlines()[-1].split()[1:])
    assert not imported & HEAVY


def test_lists_tell_programs_what_people_read(bench):
    known = {m["name"]: m for m in json.loads(bench("list", "methods", "--json").stdout)}
    assert known["stitching"]["needs"] == ["depth", "poses"]
    assert known["sucre_paper"]["options"]["steps"]["default"] == 200
    assert known["sucre_paper"]["options"]["lr"]["help"]
    assert "one water" in known["sucre_shared"]["description"]  # of conf/method
    metrics = {m["name"]: m for m in json.loads(bench("list", "metrics", "--json").stdout)}
    assert (metrics["psi"]["unit"], metrics["psi"]["better"], metrics["psi"]["range"]) == (
        "deg",
        "lower",
        [0, 180],
    )
    assert [
        m["name"] for m in json.loads(bench("list", "methods", "sucre", "--json").stdout)
    ] == ["sucre"]
    assert "'sucre'" in bench("list", "methods", "sucer").stderr
    assert "demo" in bench("list", "experiments").stdout
    assert "colmap" in bench("list", "datasets").stdout


@pytest.mark.parametrize(
    ("fault", "status", "said"),
    [
        (
            OSError(errno.ENOSPC, "No space left on device"),
            2,
            r"^error: a file: No space left .*; ",
        ),
        (
            PermissionError(errno.EACCES, "Permission denied", "a\rb.png"),
            2,
            r"^error: a\\rb\.png: Permission denied; ",
        ),
        (OSError(errno.ENOMEM, "Cannot allocate memory"), 1, r"^error: .*not enough memory; "),
        (
            ImportError("no symbol", name="numba"),
            1,
            r"^error: a Python package does not import: no symbol; ",
        ),
        (ConnectionRefusedError(errno.ECONNREFUSED, "Connection refused"), 0, ""),
        (ImportError("cannot import name 'x'", name="sucre_bench.scene"), 0, ""),
    ],
)
def test_an_error_of_a_file_or_package_is_one_line_and_a_fault_of_the_code_is_raised(
    bench, monkeypatch: pytest.MonkeyPatch, fault: Exception, status: int, said: str
):
    monkeypatch.setattr(completion, "callback", Mock(side_effect=fault))
    if not said:
        with pytest.raises(type(fault)):
            bench("completion", "bash")
        return
    done = bench("completion", "bash")
    assert (done.returncode, len(done.errors)) == (status, 1)
    assert re.search(said, done.stderr)


def test_ctrl_c_before_the_work_begins_is_one_word_and_130(bench, tmp_path: Path):
    (tmp_path / "stops.py").write_text(
        "import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n"
    )
    done = bench("list", "methods", "--plugin", "stops.py")
    assert (done.returncode, done.stderr.strip()) == (130, "stopped")


def test_the_bare_command_shows_its_help(bench):
    done = bench()
    assert done.returncode == 0
    assert done.stdout.startswith("Usage: sucre-bench")


def test_an_unknown_flag_is_not_taken_for_an_override(bench):
    done = bench("run", "--mutlirun", "method=gray_world")
    assert done.returncode == 2
    assert "did you mean '--multirun'" in done.stderr.lower()
    done = bench("run", "--method.fill=true", "method=sucre")
    assert (done.returncode, "write method.fill=VALUE" in done.stderr) == (2, True)


def test_the_last_lines_say_what_came_out_and_where(bench, toys: str):
    done = bench("run", "-m", "--plugin", toys, "dataset=toy", "method=gain,faulty,needs_charts", "metrics=[redness]",
                 "tracking.uri=off", "out=results")  # fmt: skip
    assert done.returncode == 1
    lines = done.stdout.splitlines()
    assert lines[-4:] == [
        "5 ok, 1 failed, 3 skipped",
        "log      results/logs/failures.log",
        "results  results",
        "page     results/report/index.html",
    ]
    assert [
        line
        for line in lines
        if re.match(r"failed  toy / faulty / v1\.png: ValueError: boom .*lines", line)
    ]
    lack = Lack(("charts",), ("depth", "poses", "reference", "truth"))
    assert f"skipped  toy / needs_charts / 3 views: {lack}" in lines
    assert "Traceback" not in done.stderr + done.stdout
    assert "\x1b" not in done.stdout  # no colours where nobody sees them


def test_compare_reads_what_run_wrote(bench, toys: str):
    bench("run", "-m", "--plugin", toys, "dataset=toy", "method=gain", "method.gain=0.5,1", "metrics=[psnr,redness]",
          "tracking.uri=off", "out=results")  # fmt: skip
    table = bench("compare", "results").stdout
    assert re.search(r"psnr: gain,gain=\S+ (leads|is ahead of) gain,gain=", table)
    assert "redness: gain" not in table  # of which nobody knows what it says of colours
    latex = bench("compare", "results", "--metric", "redness", "--format", "latex").stdout
    assert latex.startswith("\\begin{tabular}{lr}\n\\toprule")
    by_view = bench("compare", "results", "--by", "view", "--format", "csv").stdout
    assert 'toy · v1.png,"gain,gain=0.5"' in by_view


def test_cfg_prints_the_configuration_and_runs_nothing(bench, tmp_path: Path):
    said = bench("run", "method=gray_world", "--cfg").stdout
    assert "name: gray_world" in said
    assert not list(tmp_path.iterdir())
