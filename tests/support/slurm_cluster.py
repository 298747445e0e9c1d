"""A SLURM of one node on this machine, for the tests: the daemons of Debian's packages in a folder of their own.

It has no accounting: a small `sacct` of our own answers what submitit asks, from the controller.
"""

import os
import random
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

_PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scancel")
_PATIENCE_S = 300  # for a busy machine
_INSTALL = "apt-get install -y --no-install-recommends slurmctld slurmd slurm-client munge"

_SLURM_CONF = """
ClusterName=tests
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=5
CredType=cred/munge
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/affinity
SwitchType=switch/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerType=sched/backfill
SchedulerParameters=batch_sched_delay=0,sched_interval=1,bf_interval=1
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
JobCompType=jobcomp/none
ReturnToService=2
KillWait=120
InactiveLimit=0
MinJobAge=86400
MaxArraySize={max_array}
NodeName={host} NodeAddr=127.0.0.1 CPUs={cores} RealMemory=500 State=UNKNOWN
PartitionName=tests Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""

_SACCT = r"""#!/bin/sh
echo 'JobID|State|NodeList'
scontrol -o show job | sed -nE \
  -e 's/^.*ArrayJobId=([0-9]+) ArrayTaskId=([0-9]+) .*JobState=([A-Z_]+) .*$/\1_\2|\3|node/p' \
  -e '/ArrayTaskId/!s/^JobId=([0-9]+) .*JobState=([A-Z_]+) .*$/\1|\2|node/p'
"""


def what_is_missing() -> str:
    """Return why no cluster can be started here, and what to do; empty when one can."""
    path = f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin"
    if absent := [name for name in _PROGRAMS if not shutil.which(name, path=path)]:
        return f"no {', '.join(absent)}; {_INSTALL}"
    return "" if os.geteuid() == 0 else "the daemons are started as root; run the tests as root"


@contextmanager
def slurm(max_array: int = 1001) -> Iterator[dict[str, str]]:
    """Start a cluster; yield the environment variables with which SLURM's commands, and ours, reach it.

    max_array: MaxArraySize, the most jobs of one array.
    """
    with ExitStack() as stack:
        # Short, whatever TMPDIR says: a socket's path may have no more than 108 characters.
        made = tempfile.TemporaryDirectory(
            prefix="slurm-", dir="/tmp", ignore_cleanup_errors=True
        )
        folder = Path(stack.enter_context(made))
        conf = folder / "slurm.conf"
        host, cores = socket.gethostname().partition(".")[0], len(os.sched_getaffinity(0))
        settings = {
            "host": host,
            "folder": folder,
            "ports": _free_ports(2),
            "max_array": max_array,
            "cores": cores,
        }
        conf.write_text(_SLURM_CONF.format(**settings))
        for name in ("state", "spool"):
            (folder / name).mkdir()
        key = folder / "munge.key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o400)
        folder.chmod(0o755)  # munge refuses folders that others may write to
        (folder / "bin").mkdir()
        (folder / "bin" / "sacct").write_text(_SACCT)
        (folder / "bin" / "sacct").chmod(0o755)
        there = {
            "SLURM_CONF": str(conf),
            "PATH": f"{folder / 'bin'}:{os.environ['PATH']}:/usr/sbin:/sbin",
        }
        files = [
            f"--{name}-file={folder}/munge.{name}" for name in ("key", "pid", "log", "seed")
        ]
        _start(
            stack,
            folder,
            there,
            "munged",
            "--foreground",
            f"--socket={folder}/munge.socket",
            *files,
        )
        _wait_for(folder / "munge.socket")
        _start(stack, folder, there, "slurmctld", "-i", "-D")
        _start(stack, folder, there, "slurmd", "-D")
        _wait_until_idle(folder, there)
        stack.callback(end_all, there)
        yield there


def end_all(environment: dict[str, str]) -> None:
    """End the jobs that a test left: the daemons leave their processes behind."""
    everything = {**os.environ, **environment}
    subprocess.run(["scancel", f"--user={os.getuid()}"], env=everything, check=False)
    ask, until = ["squeue", "--noheader"], time.monotonic() + _PATIENCE_S
    while subprocess.run(ask, capture_output=True, env=everything, check=False).stdout:
        assert time.monotonic() < until, "jobs of a test do not end"
        time.sleep(0.1)


def _free_ports(count: int) -> list[int]:
    """Ports below those that the system gives to whoever asks for any: nobody else takes one before SLURM does."""
    found: list[int] = []
    for port in random.SystemRandom().sample(range(10_000, 30_000), 1000):
        with socket.socket() as one, suppress(OSError):
            one.bind(("127.0.0.1", port))
            found.append(port)
        if len(found) == count:
            return found
    raise RuntimeError("no free ports")


def _start(stack: ExitStack, folder: Path, environment: dict[str, str], *command: str) -> None:
    log = stack.enter_context((folder / f"{command[0]}.out").open("wb"))
    everything = {**os.environ, **environment}
    process = subprocess.Popen(
        command, stdout=log, stderr=log, env=everything, start_new_session=True
    )
    stack.callback(_stop, process)


def _stop(process: subprocess.Popen[bytes]) -> None:
    process.send_signal(signal.SIGTERM)
    try:
        process.wait(30)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _wait_for(path: Path) -> None:
    until = time.monotonic() + _PATIENCE_S
    while not path.exists():
        assert time.monotonic() < until, f"{path.name} is not made"
        time.sleep(0.05)


def _wait_until_idle(folder: Path, environment: dict[str, str]) -> None:
    ask, until = ["sinfo", "--noheader", "--format=%T"], time.monotonic() + _PATIENCE_S
    answer = ""
    while time.monotonic() < until:
        told = subprocess.run(
            ask, capture_output=True, text=True, check=False, env={**os.environ, **environment}
        )
        answer = told.stdout.strip() or told.stderr.strip()
        if answer == "idle":
            return
        time.sleep(0.1)
    logs = "\n".join(
        f"-- {path.name}\n{path.read_text()[-1000:]}"
        for path in sorted(folder.glob("*.*o*[gt]"))
    )
    raise RuntimeError(f"SLURM did not come up: {answer}\n{logs}")
