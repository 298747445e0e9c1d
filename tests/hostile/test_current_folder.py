"""A folder that holds Python files with the names of what sucre_bench imports: no command runs any of them."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from support.colmap_folder import write_dive
from support.command_line import PROGRAM, run_program
from support.places import ROOT

from sucre_bench.machine.processes import environment_of_programs, isolated_children

# Commands that start other processes, each in a process of its own.
STARTING = {
    "run with workers": (
        "run -m dataset=colmap dataset.root=dive method=gray_world,clahe metrics=[uciqe] report=false "
        "tracking.uri=off hydra/launcher=joblib hydra.launcher.n_jobs=2 first=1 out=results"
    ),
    "check": "check gray_world",
    "doctor": "doctor",
}
# All the others, one after the other in one process.
ALONE = (
    "run dataset=colmap dataset.root=dive method=gray_world first=1 out=alone",
    "compare alone",
    "report alone",
    "track alone",
    "score dive/images/a.png --metrics uciqe",
    "describe colmap dataset.root=dive --no-sheet",
    "charts dive/images/a.png --accept",
    "texture alone points.ply --method gray_world",
    "video alone dive.mp4 --methods gray_world",
    "prepare dive/images prepared",
    "lineup alone",
    "study alone --methods gray_world,gray_world --out study.html",
    "bundle alone bundles/alone.zip",
    "verify bundles/alone.zip",
    "site bundles public",
    "list methods",
    "new method mine",
    "completion bash",
)
_ONE_PROCESS = """
import sys
from sucre_bench.cli import cli
from sucre_bench.errors import SucreBenchError
from sucre_bench.machine.processes import isolated_children
for words in sys.argv[1:]:
    try:
        with isolated_children():
            cli(words.split(), standalone_mode=False)
    except (SystemExit, SucreBenchError):
        pass
"""


@pytest.fixture(scope="module")
def trapped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dive in a folder where every importable name but ours is a file that notes its import."""
    folder = tmp_path_factory.mktemp("trapped")
    write_dive(folder / "dive", ("a.png", "b.png"))
    note = f"import builtins\nopen({str(folder / 'sprung')!r}, 'a').write(__name__ + '\\n')\n"
    for name in {*sys.stdlib_module_names, *packages_distributions()} - {"sucre_bench"}:
        if name.isidentifier():
            (folder / f"{name}.py").write_text(note)
    return folder


def sprung(folder: Path) -> list[str]:
    """The modules of the folder that were imported since the last call."""
    note = folder / "sprung"
    names = note.read_text().split() if note.exists() else []
    note.unlink(missing_ok=True)
    return names


@pytest.mark.parametrize("command", STARTING.values(), ids=STARTING)
def test_no_process_that_a_command_starts_imports_from_the_current_folder(trapped: Path, command: str):
    done = run_program(trapped, *command.split(), PYTHONPATH=str(ROOT))
    assert sprung(trapped) == []
    assert "Traceback" not in done.stderr


def test_the_page_of_mlflow_imports_nothing_from_the_current_folder(trapped: Path):
    run = "run dataset=colmap dataset.root=dive method=gray_world metrics=[uciqe] tracking.uri=off out=tracked"
    assert run_program(trapped, *run.split()).returncode == 0
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    words = [PROGRAM, "track", "tracked", "--ui", "--port", port]
    with subprocess.Popen(words, cwd=trapped, stdout=subprocess.PIPE, text=True) as serving:
        try:
            assert serving.stdout
            opened = any("(Ctrl-C ends it)" in line for line in serving.stdout)
        finally:
            serving.send_signal(signal.SIGINT)
    assert sprung(trapped) == []
    assert opened


def test_no_command_imports_from_the_current_folder(trapped: Path):
    words = [sys.executable, "-P", "-c", _ONE_PROCESS, *ALONE]
    done = subprocess.run(words, cwd=trapped, capture_output=True, text=True, check=False, timeout=900)
    assert sprung(trapped) == []
    assert "Traceback" not in done.stderr


def test_a_program_of_the_user_imports_what_lies_beside_it(tmp_path: Path):
    (tmp_path / "beside.py").write_text("found = 'beside'")
    (tmp_path / "program.py").write_text("import beside; print(beside.found)")
    with isolated_children():
        words = [sys.executable, tmp_path / "program.py"]
        done = subprocess.run(words, env=environment_of_programs(), capture_output=True, text=True, check=True)
    assert done.stdout == "beside\n"
