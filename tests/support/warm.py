"""Does what the first run of a process does once: for the process that commands of tests are forked from."""

import importlib
import tempfile
from pathlib import Path

from sucre_bench.machine.compute import start_compiler
from support.command_line import run_here
from support.places import TOYS

for package in (
    "scipy.ndimage",
    "scipy.optimize",
    "scipy.sparse.csgraph",
    "scipy.spatial",
    "scipy.stats",
):
    importlib.import_module(package)  # as engine/workers.py does
start_compiler()
WORDS = "dataset=toy method=gain,gain2 metrics=[redness] workers=0 report=false tracking.uri=off out=out"
with tempfile.TemporaryDirectory() as folder:
    run_here(Path(folder), "run", "-m", "--plugin", str(TOYS), *WORDS.split())
