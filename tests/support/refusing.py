"""Machines that refuse: the rights of an ordinary user, limits, and disks that are too small."""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from support.command_line import forks

_VERSION_3 = 0x20080522  # of Linux's capabilities
_REFUSED = 13  # exit code


def as_user() -> None:
    """Take from this process what root may do to the files of others; permissions then count for root as well."""
    if os.geteuid() != 0:
        return
    header = (ctypes.c_uint32 * 2)(_VERSION_3, 0)
    nothing = (ctypes.c_uint32 * 6)()
    assert ctypes.CDLL(None, use_errno=True).capset(header, nothing) == 0


def skip_unless_refused(folder: Path) -> None:
    """Skip a test where root's rights cannot be taken from a process, or rights of files mean nothing."""
    secret = folder / "secret"
    secret.touch(mode=0)
    process = forks().Process(target=_open_as_user, args=(secret,))
    process.start()
    process.join()
    secret.unlink()
    if process.exitcode != _REFUSED:
        pytest.skip("this system refuses root nothing")


def _open_as_user(path: Path) -> None:
    with contextlib.suppress(PermissionError):
        as_user()
        path.open().close()
        os._exit(0)
    os._exit(_REFUSED)


def with_small_files(n_bytes: int) -> None:
    """Let this process write no file of more bytes."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, n_bytes))


def on_small_disk(folder: Path, name: str, n_bytes: int, script: str) -> subprocess.CompletedProcess[str]:
    """Run a shell script in a folder, with a disk of some bytes mounted at folder/name. Skips where none can be."""
    (folder / name).mkdir()
    mount = ["unshare", "--mount", "sh", "-c"]
    disk = f"mount -t tmpfs -o size={n_bytes} tmpfs '{name}'"
    try:
        subprocess.run([*mount, disk], cwd=folder, check=True, capture_output=True, timeout=60)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("this user may mount no disk here")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    whole = [*mount, f"{disk} && {script}"]
    return subprocess.run(whole, cwd=folder, check=False, capture_output=True, text=True, timeout=600, env=environment)
