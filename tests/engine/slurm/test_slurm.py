"""Sweeps on a real SLURM, started here: what is lost with a job, what is not, and that nothing hangs."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from support import slurm_cluster
from support.command_line import but_times
from support.places import TOYS

from sucre_bench import results
from sucre_bench.engine.hydra_run import run_words as run_jobs

BENCH = str(Path(sys.executable).with_name("sucre-bench"))
PATIENCE_S = 600  # for a busy machine
QUIET = ("tracking.uri=off", "report=false")
ARRAY = 4  # the most jobs of one array, in the cluster of these tests: one less than the jobs of the longest sweep

EVENTFUL = '''
import json
import os
import time
from dataclasses import dataclass
from pathlib import Path

from sucre_bench import Restoration, Scene, View, method


@method()
@dataclass(frozen=True)
class Eventful:
    """Notes each call; waits at some views until something happens to it, once; fails at one until it is mended."""

    notes: Path
    """A folder."""
    waits: tuple[str, ...] = ()
    """Views to wait at."""
    fails: str = ""
    """A view that fails."""

    def restore(self, scene: Scene, view: View) -> Restoration:
        import cv2

        with (self.notes / "calls").open("a") as file:
            file.write(f"{view.name}\\n")
        waited = self.notes / f"{view.name}.waited"
        if view.name in self.waits and not waited.exists():
            threads = {name: value for name, value in os.environ.items() if name.endswith("_NUM_THREADS")}
            told = {"cores": len(os.sched_getaffinity(0)), "opencv": cv2.getNumThreads(), **threads}
            number = [os.environ.get(f"SLURM_ARRAY_{name}_ID", "") for name in ("JOB", "TASK")]
            here = {"job": "_".join(number), "pid": os.getppid(), "threads": told}
            waited.with_suffix(".new").write_text(json.dumps(here))
            waited.with_suffix(".new").replace(waited)
            time.sleep(3600)
        if view.name == self.fails and not (self.notes / "mended").exists():
            raise ValueError("boom")
        return Restoration(view.rgb * 1.0)
'''


@pytest.fixture(scope="module")
def cluster() -> Iterator[dict[str, str]]:
    missing = slurm_cluster.what_is_missing()
    if missing and os.environ.get("SUCRE_BENCH_TEST_SLURM") != "1":
        pytest.skip(f"no SLURM can be started here: {missing}")
    assert not missing, missing
    with slurm_cluster.slurm(max_array=ARRAY) as environment:
        yield environment


class Bench:
    """A user at a login node: runs sweeps of the eventful method in the background, and SLURM's commands."""

    def __init__(
        self, folder: Path, cluster: dict[str, str], commands: contextlib.ExitStack
    ) -> None:
        self.out, self.notes, self.plugin = (
            folder / "out",
            folder / "notes",
            folder / "eventful.py",
        )
        self.notes.mkdir()
        self.plugin.write_text(EVENTFUL)
        self._commands = commands
        self.environment = {**os.environ, **cluster, "COLUMNS": "300"}

    @property
    def fixed(self) -> list[str]:
        return [
            "dataset=toy",
            "method=eventful",
            f"method.notes={self.notes}",
            "metrics=[psnr]",
            *QUIET,
        ]

    def start(self, *overrides: str, launcher: str = "slurm") -> subprocess.Popen[str]:
        plugins = [f"--plugin={TOYS}", f"--plugin={self.plugin}"]
        where = [
            f"out={self.out}",
            f"hydra/launcher={launcher}",
            "hydra.launcher.submitit_folder=${out}/logs/slurm",
        ]
        command = subprocess.Popen(
            [BENCH, "run", "-m", *plugins, *self.fixed, *where, *overrides],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=self.environment,
            cwd=self.notes,
        )
        self._commands.enter_context(command)
        self._commands.callback(command.kill)
        return command

    def run(self, *overrides: str, launcher: str = "slurm") -> tuple[int, str]:
        process = self.start(*overrides, launcher=launcher)
        said, _ = process.communicate(timeout=PATIENCE_S)
        return process.returncode, said

    def slurm(self, *command: str) -> str:
        """What a command of SLURM's answers. Its exit code may be an error though it did what it was to do."""
        return subprocess.run(
            command, env=self.environment, check=False, capture_output=True, text=True
        ).stdout

    def job_at(self, view: str, of: subprocess.Popen[str]) -> str:
        """The id of the job that waits at a view."""
        until((self.notes / f"{view}.waited").exists, of)
        return str(self.told_at(view)["job"])

    def told_at(self, view: str) -> dict[str, Any]:
        """What the job that waited at a view found there."""
        told: dict[str, Any] = json.loads((self.notes / f"{view}.waited").read_text())
        return told

    def at_work(self) -> list[str]:
        return self.slurm("squeue", "--noheader", "--array", "--format=%i").split()

    def until_no_job_is_at_work(self) -> None:
        until(lambda: self.at_work() == [])

    def stored(self) -> set[str]:
        """The views whose rows are on the disk."""
        return (
            set(results.read(self.out)["view"])
            if any(self.out.glob("parts/*.parquet"))
            else set()
        )

    def calls(self) -> list[str]:
        path = self.notes / "calls"
        return sorted(path.read_text().split()) if path.exists() else []


def until(true: Callable[[], bool], process: subprocess.Popen[str] | None = None) -> None:
    """Wait until something is true; while a process runs, where there is one."""
    deadline = time.monotonic() + PATIENCE_S
    while not true():
        assert process is None or process.poll() is None, process.communicate()[0]
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.fixture
def user(tmp_path: Path, cluster: dict[str, str]) -> Iterator[Bench]:
    with contextlib.ExitStack() as commands:
        yield Bench(tmp_path, cluster, commands)
    slurm_cluster.end_all(cluster)


SHARDS = ("dataset.views=10", "shard.count=5", "shard.index=range(5)")


def test_a_killed_job_loses_itself_and_the_same_command_does_what_is_left(
    user: Bench, tmp_path: Path
):
    events = ("method.waits=[v3.png]", "method.fails=v1.png")
    command = user.start(*SHARDS, *events)
    killed = user.job_at("v3.png", command)
    # rows wait up to .3 s, and SIGKILL leaves no time to write them
    until(lambda: "v2.png" in user.stored(), command)
    user.slurm("scancel", "--signal=KILL", "--full", killed)  # as for want of memory
    said, _ = command.communicate(timeout=PATIENCE_S)

    assert command.returncode == 1, said
    rows = results.read(user.out)
    done = set(rows[(rows["metric"] == "psnr") & (rows["status"] == "ok")]["view"])
    assert done == {f"v{i}.png" for i in range(10)} - {"v1.png", "v3.png"}, said
    assert f"SLURM job {killed} was lost" in said, said
    assert "ValueError: boom" in said
    assert "8 ok, 2 failed" in said
    assert set(user.told_at("v3.png")["threads"].values()) == {1, "1"}

    (user.notes / "calls").unlink()
    (user.notes / "mended").touch()
    code, said = user.run(*SHARDS, *events)
    assert (code, user.calls()) == (0, ["v1.png", "v3.png"]), said
    assert "10 ok (8 cached), 0 failed" in said

    here = [*user.fixed, "dataset.views=10", *events, f"out={tmp_path / 'whole'}"]
    assert not run_jobs([*here, f"plugins=[{TOYS},{user.plugin}]"], False).failed
    assert but_times(results.read(user.out)).equals(but_times(results.read(tmp_path / "whole")))


def test_ctrl_c_cancels_the_jobs_and_keeps_what_they_did(user: Bench):
    command = user.start(
        "dataset.views=4", "shard.count=2", "shard.index=0,1", "method.waits=[v3.png]"
    )
    user.job_at("v3.png", command)
    done = {"v0.png", "v1.png", "v2.png"}
    # the other job starts when it will, so all that this test asks for is stored before the command ends
    until(lambda: done <= user.stored(), command)
    command.send_signal(signal.SIGINT)
    said, _ = command.communicate(timeout=PATIENCE_S)
    assert command.returncode == 130, said
    user.until_no_job_is_at_work()
    assert done <= set(results.read(user.out)["view"])


def test_the_launcher_of_submitit_works_too(user: Bench):
    code, said = user.run(
        "dataset.views=2", "shard.count=2", "shard.index=0,1", launcher="submitit_slurm"
    )
    assert code == 0, said
    assert "2 ok, 0 failed" in said
