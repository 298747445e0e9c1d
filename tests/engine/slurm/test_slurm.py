"""Sweeps on a real SLURM, started here: what is lost with a job, what is not, and that nothing hangs."""

import contextlib
import itertools
import json
import os
import pickle
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from support import slurm_cluster
from support.colmap_folder import picture, write_image
from support.command_line import but_times
from support.messages import names
from support.places import TOYS

from sucre_bench import results
from sucre_bench.engine.run import run as run_jobs
from sucre_bench.engine.slurm import Submitted, job_states, largest_array, wait

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

    def __init__(self, folder: Path, cluster: dict[str, str], commands: contextlib.ExitStack) -> None:
        self.out, self.notes, self.plugin = folder / "out", folder / "notes", folder / "eventful.py"
        self.notes.mkdir()
        self.plugin.write_text(EVENTFUL)
        self._commands = commands
        self.environment = {**os.environ, **cluster, "COLUMNS": "300"}

    @property
    def fixed(self) -> list[str]:
        return ["dataset=toy", "method=eventful", f"method.notes={self.notes}", "metrics=[psnr]", *QUIET]

    def start(self, *overrides: str, launcher: str = "slurm") -> subprocess.Popen[str]:
        plugins = [f"--plugin={TOYS}", f"--plugin={self.plugin}"]
        where = [f"out={self.out}", f"hydra/launcher={launcher}", "hydra.launcher.latency_s=1"]
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
        return subprocess.run(command, env=self.environment, check=False, capture_output=True, text=True).stdout

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
        return set(results.read(self.out)["view"]) if any(self.out.glob("parts/*.parquet")) else set()

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


def test_a_sweep_survives_what_happens_to_its_jobs_and_the_same_command_does_what_is_left(user: Bench, tmp_path: Path):
    events = ("method.waits=[v3.png,v5.png,v7.png]", "method.fails=v1.png")
    command = user.start(*SHARDS, *events)
    killed = user.job_at("v3.png", command)
    until(lambda: "v2.png" in user.stored(), command)  # rows wait up to .3 s, and SIGKILL leaves no time to write them
    os.kill(user.told_at("v3.png")["pid"], signal.SIGKILL)  # as for want of memory
    late = user.job_at("v5.png", command)
    user.slurm("scancel", "--signal=USR2", late)  # what SLURM sends some time before the limit
    again = user.job_at("v7.png", command)
    user.slurm("scontrol", "requeue", again)  # what becomes of a job whose node fails
    said, _ = command.communicate(timeout=PATIENCE_S)

    assert command.returncode == 1, said
    rows = results.read(user.out)
    done = set(rows[(rows["metric"] == "psnr") & (rows["status"] == "ok")]["view"])
    assert done == {f"v{i}.png" for i in range(10)} - {"v1.png", "v3.png", "v5.png"}, said
    assert f"SLURM job {killed} (shard 1 of 5) was killed (FAILED" in said, said
    assert re.search(rf"SLURM job {late} \(shard 2 of 5\) .*time limit", said)
    assert "ValueError: boom" in said
    assert "7 ok, 3 failed" in said
    assert user.calls().count("v7.png") == 2
    array = killed.removesuffix("_1")
    assert (late, again) == (f"{array}_2", f"{array}_3")
    assert re.search(rf"SLURM job {array}, \d+: logs in", said)  # the fifth job found no place in the array
    assert set(user.told_at("v3.png")["threads"].values()) == {1, "1"}

    (user.notes / "calls").unlink()
    (user.notes / "mended").touch()
    code, said = user.run(*SHARDS, *events)
    assert (code, user.calls()) == (0, ["v1.png", "v3.png", "v5.png"]), said
    assert "10 ok (7 cached), 0 failed" in said

    here = [*user.fixed, "dataset.views=10", *events, f"out={tmp_path / 'whole'}"]
    assert not run_jobs([*here, f"plugins=[{TOYS},{user.plugin}]"], False).failed
    assert but_times(results.read(user.out)).equals(but_times(results.read(tmp_path / "whole")))


def test_ctrl_c_cancels_the_jobs_and_keeps_what_they_did(user: Bench):
    command = user.start("dataset.views=4", "shard.count=2", "shard.index=0,1", "method.waits=[v3.png]")
    at_work = user.job_at("v3.png", command)
    command.send_signal(signal.SIGINT)
    said, _ = command.communicate(timeout=PATIENCE_S)
    assert command.returncode == 130, said
    assert "cancelling SLURM job" in said
    user.until_no_job_is_at_work()
    assert {"v2.png"} <= set(results.read(user.out)["view"]) <= {"v0.png", "v1.png", "v2.png"}, said
    assert "KeyboardInterrupt" in (user.out / "logs" / "slurm" / f"{at_work}_0_log.err").read_text()  # not SIGKILL


def test_jobs_whose_command_was_killed_are_not_doubled(user: Bench):
    overrides = ("dataset.views=2", "shard.count=2", "shard.index=0,1", "method.waits=[v1.png]")
    command = user.start(*overrides)
    waiting = user.job_at("v1.png", command)
    until(lambda: user.at_work() == [waiting], command)  # the other shard's job has stored its view and ended
    command.kill()
    command.communicate()
    left = waiting.partition("_")[0]
    code, said = user.run(*overrides)
    assert code == 1
    assert f"SLURM job {left} " in said
    user.slurm("scancel", left)
    user.until_no_job_is_at_work()
    code, said = user.run(*overrides, launcher="submitit_slurm")
    assert (code, user.calls()) == (0, ["v0.png", "v1.png", "v1.png"]), said


def test_what_slurm_refuses_is_said_in_its_words(user: Bench):
    code, said = user.run("dataset.views=2", "shard.count=2", "shard.index=0,1", "hydra.launcher.partition=nowhere")
    assert code == 1
    assert "SLURM took 0 of 2 jobs; sbatch: error" in said
    assert "invalid partition" in said
    assert user.at_work() == []


def test_photographs_are_restored_in_blocks(user: Bench, tmp_path: Path):
    for n in range(4):
        write_image(tmp_path / "photos" / f"{n}.jpg", picture(n))
    words = [BENCH, "restore", "photos", "--method", "gray_world"]
    where = ["shard.count=2", "hydra/launcher=slurm", "hydra.launcher.latency_s=1"]
    for command in ([*words, "blocks", *where], [*words, "whole", "workers=0"]):
        done = subprocess.run(
            command, env=user.environment, cwd=tmp_path, check=False, capture_output=True, text=True, timeout=PATIENCE_S
        )
        assert done.returncode == 0, done.stdout + done.stderr
    made = [{f.name: f.read_bytes() for f in (tmp_path / out / "pictures").iterdir()} for out in ("blocks", "whole")]
    assert len(made[0]) == 4
    assert made[0] == made[1]
    assert list((tmp_path / "blocks/work").rglob("slurm")), "the cluster did the work"


def test_without_slurm_the_launcher_says_where_to_go(bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PATH", "")
    words = ("dataset=toy", "method=gain", "metrics=[psnr]", "shard.count=2", "shard.index=0,1", "hydra/launcher=slurm")
    done = bench("run", "-m", "--plugin", str(TOYS), *words, *QUIET, f"out={tmp_path / 'out'}")
    assert done.returncode == 1
    assert "sbatch" in done.stdout + done.stderr


# -- waiting, without a cluster ----------------------------------------------------------------------------

OFTEN = {"look_s": 0.01, "ask_s": 0.0}


@pytest.fixture
def job(tmp_path: Path) -> Submitted:
    (tmp_path / "log").write_text("one\nexecve(): python: No such file or directory\n\n")
    return Submitted("7_1", tmp_path / "result.pkl", tmp_path / "log")


def answers(*states: str | None, then: Callable[[], object] = lambda: None) -> Callable[[], dict[str, str] | None]:
    """A queue that says of job 7_1 one thing after another, "" when it does not list it; the last for ever."""
    left = list(states)

    def answer() -> dict[str, str] | None:
        state = left.pop(0) if len(left) > 1 else left[0]
        if len(left) == 1:
            then()
        return None if state is None else {"8": "RUNNING", **({"7_1": state} if state else {})}

    return answer


def leaves(job: Submitted, outcome: object) -> Callable[[], object]:
    return lambda: job.result.write_bytes(pickle.dumps(outcome))


@pytest.mark.parametrize(
    ("states", "named"),
    [
        (["RUNNING", "OUT_OF_MEMORY"], {"hydra.launcher.mem_gb=", "OUT_OF_MEMORY"}),
        (["RUNNING", "FAILED"], {"killed", "FAILED", "execve"}),
        (["RUNNING", "TIMEOUT", ""], {"hydra.launcher.timeout_min="}),  # listed for a while only
        (["RUNNING", ""], {"SLURM", "known"}),
        (["PENDING", "CANCELLED"], {"cancelled", "CANCELLED"}),
    ],
)
def test_a_job_that_ended_without_a_result_is_lost(job: Submitted, states: list[str], named: set[str]):
    ((ended, fault),) = wait([job], answers(*states), latency_s=0.05, **OFTEN)
    assert ended is job
    assert named <= names(fault)
    assert fault.endswith(f"; log: {job.log}")


@pytest.mark.parametrize(
    ("states", "latency_s"),
    [(["RUNNING", None, None], 0), (["COMPLETED", "COMPLETED"], 600), (["NODE_FAIL", "PENDING", "RUNNING"], 0)],
)
def test_a_job_is_not_given_up_too_early(job: Submitted, states: list[str | None], latency_s: float):
    """A controller that is down says nothing of jobs; results may come late; a job may start anew."""
    asked = itertools.count(1)

    def late() -> None:
        if next(asked) == 20:
            leaves(job, ("success", ""))()

    assert list(wait([job], answers(*states, then=late), latency_s=latency_s, **OFTEN)) == [(job, "")]


@pytest.mark.parametrize(
    ("outcome", "reason"),
    [
        (("success", ""), ""),
        (("success", "reached its time limit"), "reached its time limit"),
        (("error", "Traceback\n  ...\nImportError: no such library\n"), "failed, ImportError: no such library; log: "),
    ],
)
def test_a_result_says_how_a_job_ended(job: Submitted, outcome: object, reason: str):
    ((_, fault),) = wait([job], answers("RUNNING", "RUNNING", then=leaves(job, outcome)), latency_s=9, **OFTEN)
    assert fault.startswith(reason)
    assert bool(fault) is bool(reason)


def test_a_damaged_result_is_a_fault(job: Submitted):
    job.result.write_bytes(b"\x80")
    ((_, fault),) = wait([job], answers("RUNNING"), latency_s=9, **OFTEN)
    assert re.search(r"\((EOF|Unpickling)Error\)", fault)


def test_the_size_of_arrays_is_the_clusters(cluster: dict[str, str], monkeypatch: pytest.MonkeyPatch):
    for name, value in cluster.items():
        monkeypatch.setenv(name, value)
    assert largest_array() == ARRAY
    monkeypatch.setenv("PATH", "")
    assert largest_array() == 1001
    assert job_states() is None
