"""Installs a package of plugins into a folder of its own, without the network."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def install(source: Path, target: Path) -> None:
    """Install the package in `source` into `target`, without what it needs."""
    quietly = ["-q", "--disable-pip-version-check", "--no-compile"]
    alone = ["--no-deps", "--no-build-isolation"]
    command = [sys.executable, "-m", "pip", "install", *quietly, *alone, "--target", str(target), str(source)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
