"""A folder that holds Python files with the names of what sucre_bench imports: no command runs any of them."""

import os
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

from support.colmap_folder import write_dive
from support.places import ROOT

from sucre_bench.machine.processes import environment_of_programs, isolated_children

# The commands that start other processes of Python, and some that do not, one after the other in one process.
COMMANDS = (
    "run -m dataset=colmap dataset.root=dive method=gray_world,clahe metrics=[uciqe] report=false tracking.uri=off "
    "hydra/launcher=joblib hydra.launcher.n_jobs=2 first=1 out=results",
    "check gray_world",
    "doctor",
    "report results",
    "describe colmap dataset.root=dive --no-sheet",
    "prepare dive/images prepared",
    "bundle results bundles/results.zip",
    "completion bash",
)
# Python puts the folder of a program's file on the path, as it does for sucre-bench.
ONE_PROCESS = """
import os, sys
from sucre_bench.cli import cli
from sucre_bench.errors import SucreBenchError
from sucre_bench.machine.processes import isolated_children

if __name__ == "__main__":
    for words in sys.argv[1:]:
        os.environ["THE_COMMAND"] = words
        try:
            with isolated_children():
                cli(words.split(), standalone_mode=False)
        except (SystemExit, SucreBenchError):
            pass
"""
TRAP = """
import os
with open({note!r}, "a") as note:
    note.write(f"{{__name__}} by {{os.environ.get('THE_COMMAND')}}\\n")
"""


def test_no_command_imports_from_the_current_folder(tmp_path: Path):
    """Every importable name but ours is a file there that notes its import."""
    folder, program = tmp_path / "trapped", tmp_path / "program" / "all.py"
    write_dive(folder / "dive", ("a.png", "b.png"))
    for name in {*sys.stdlib_module_names, *packages_distributions()} - {"sucre_bench"}:
        if name.isidentifier():
            (folder / f"{name}.py").write_text(TRAP.format(note=str(folder / "sprung")))
    program.parent.mkdir()
    program.write_text(ONE_PROCESS)
    done = subprocess.run(
        [sys.executable, program, *COMMANDS],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
        timeout=900,
    )
    assert not (folder / "sprung").exists(), (folder / "sprung").read_text()
    assert "Traceback" not in done.stderr
    made = ("results/report/index.html", "bundles/results.zip")
    assert all((folder / name).is_file() for name in made), done.stderr


def test_a_program_of_the_user_imports_what_lies_beside_it(tmp_path: Path):
    (tmp_path / "beside.py").write_text("found = 'beside'")
    (tmp_path / "program.py").write_text("import beside; print(beside.found)")
    with isolated_children():
        words = [sys.executable, tmp_path / "program.py"]
        done = subprocess.run(
            words, env=environment_of_programs(), capture_output=True, text=True, check=True
        )
    assert done.stdout == "beside\n"
