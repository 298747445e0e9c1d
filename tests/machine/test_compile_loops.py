"""The first compilation is announced; compiled code is read from the disk in the next process."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from sucre_bench.machine.compute import compiled

_SCRIPT = """
import sys
from sucre_bench.machine.compute import compiled
from loops import double
assert compiled(double)(2) == 4
assert "torch" not in sys.modules
"""


def test_compiling_is_announced_once_on_a_machine(tmp_path: Path):
    (tmp_path / "loops.py").write_text("def double(x):\n    return 2 * x\n")

    def told() -> str:
        here = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
        ran = subprocess.run([sys.executable, "-c", _SCRIPT], env=here, capture_output=True, text=True, check=True)
        return ran.stderr

    assert "compiling" in told()
    assert told() == ""


def test_a_loop_is_compiled_where_no_place_can_keep_it():
    """As for a user who can write neither the package's folder nor a home: numba refuses to cache such a function."""
    names: dict[str, Any] = {}
    exec("def double(x):\n    return 2 * x\n", names)  # has no file, so numba finds no place beside it
    assert compiled(names["double"])(21) == 42
