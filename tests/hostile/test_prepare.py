"""COLMAP ends the process of `prepare`: one line says where, and the remedy that it names goes on from there."""

from pathlib import Path

from support.command_line import run_here, run_program
from support.photographed_valley import POSES, photograph, write
from support.places import ROOT

# Stands before the real module on the path, and lets one of its functions do what C++ does on an exception in a thread.
ABORTING = """
import os, sys
sys.path.remove(os.path.dirname(__file__))
del sys.modules["pycolmap"]
import pycolmap
setattr(pycolmap, os.environ["ABORTS_IN"], lambda *_, **__: os.abort())
sys.modules["pycolmap"] = pycolmap
"""
PREPARE = ("prepare", "photos", "out", "--scale", "2", "--surface", "sparse")


def test_an_abort_of_colmap_is_one_line_and_the_same_command_goes_on(tmp_path: Path):
    for number, pose in enumerate(POSES[:4]):
        write(tmp_path / "photos" / f"{number}.png", photograph(pose))
    (tmp_path / "first").mkdir()
    (tmp_path / "first" / "pycolmap.py").write_text(ABORTING)
    path = f"{tmp_path / 'first'}:{ROOT}"
    done = run_program(tmp_path, *PREPARE, PYTHONPATH=path, ABORTS_IN="incremental_mapping")
    assert done.returncode == 2
    said = [line for line in done.stderr.splitlines() if "signal 6" in line]
    assert len(said) == 1
    assert "COLMAP's reconstruction; " in said[0]
    assert "command" in said[0]
    assert "Traceback" not in done.stdout + done.stderr
    again = run_here(tmp_path, *PREPARE)
    assert again.returncode == 0, again.stderr
    assert len(list((tmp_path / "out" / "depths").iterdir())) == 4
