"""A folder that holds Python files with the names of what sucre_bench imports: no command runs any of them."""

import os
import shlex
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

from support.colmap_folder import write_dive
from support.command_line import run_here
from support.places import ROOT

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
from sucre_bench.cli import main

if __name__ == "__main__":
    for words in sys.argv[1:]:
        os.environ["THE_COMMAND"] = words
        sys.argv = ["sucre-bench", *words.split()]
        try:
            main()
        except SystemExit:
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
    write_dive(tmp_path / "dive", ("a.png",))
    (tmp_path / "beside.py").write_text("import shutil, sys")
    (tmp_path / "program.py").write_text(
        "from beside import shutil, sys; shutil.copy(*sys.argv[1:])"
    )
    program = f"method.run='{sys.executable} {tmp_path}/program.py {{input}} {{output}}'"
    words = f"run dataset=colmap dataset.root=dive method=command metrics=[uciqe] report=false {program}"
    done = run_here(tmp_path, *shlex.split(words)[:-1], program, "tracking.uri=off")
    assert "1 ok" in done.stdout
