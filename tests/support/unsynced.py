"""Lets no test wait for the disk; imported for this effect. Tests kill processes, and never the machine: what a process
has written outlives it without `fsync`. Programs that tests start as they are do wait.
"""

from __future__ import annotations

import os


def _unsynced(file: object) -> None:
    """Stand for `os.fsync`."""


os.fsync = _unsynced
