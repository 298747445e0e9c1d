"""Asks SLURM's controller for the states of jobs, with commands that need no accounting database."""

import os
import re
import shutil
import subprocess
import time
from collections.abc import Collection

from sucre_bench.errors import InputError

# The final states of squeue(1). A job in any other state may still give a result.
ENDED = {
    "BOOT_FAIL",
    "CANCELLED",
    "COMPLETED",
    "DEADLINE",
    "FAILED",
    "NODE_FAIL",
    "OUT_OF_MEMORY",
    "PREEMPTED",
    "REVOKED",
    "TIMEOUT",
}
_USUAL_MAX_ARRAY = 1001  # slurm.conf(5)
_TIMEOUT_S = 60
_CANCEL_S = 15.0  # SLURM's own patience with what it ends is 30 s (KillWait)


def check_is_there() -> None:
    """Raise InputError where there is no SLURM to talk to."""
    if not all(shutil.which(name) for name in ("sbatch", "squeue", "scancel", "srun")):
        raise InputError("no sbatch here", "hydra/launcher=slurm", "give the command on a login node of the cluster")
    if states() is None:
        raise InputError("squeue gets no answer from the controller", "hydra/launcher=slurm", "try again when it runs")


def states() -> dict[str, str] | None:
    """Return the state of each of this user's jobs by its id, "12" or "12_3" in an array; None without an answer.

    A job that ended stays listed for a while (MinJobAge in slurm.conf, 5 minutes by default).
    """
    command = ["squeue", f"--user={os.getuid()}", "--noheader", "--array", "--states=all", "--format=%i|%T"]
    answer = _told(command)
    if answer is None:
        return None
    return {job.strip(): state.strip() for job, _, state in (line.partition("|") for line in answer.splitlines())}


def largest_array() -> int:
    """Return how many jobs one array may hold here; 1 where arrays are switched off."""
    found = re.search(r"^MaxArraySize\s*=\s*(\d+)", _told(["scontrol", "show", "config"]) or "", re.MULTILINE)
    return max(1, int(found[1])) if found else _USUAL_MAX_ARRAY


def array_of(job: str) -> str:
    """The id of the array that a job is of; of a single job, its own."""
    return job.partition("_")[0]


def at_work() -> list[str]:
    """The ids of this user's jobs that have not ended."""
    return [job for job, state in (states() or {}).items() if state not in ENDED]


def cancel(arrays: Collection[str]) -> None:
    """Cancel jobs and arrays by their ids, and wait for them to end: SIGTERM comes first, SIGKILL a little later."""
    _told(["scancel", *arrays])
    until = time.monotonic() + _CANCEL_S
    while time.monotonic() < until and any(array_of(job) in arrays for job in at_work()):
        time.sleep(0.5)


def _told(command: list[str]) -> str | None:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=_TIMEOUT_S)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout
