"""Sweeps on a SLURM cluster: ``sucre-bench run -m hydra/launcher=slurm``, through submitit.

Hydra's own launcher for SLURM asks ``sacct``, without which a killed job hangs the sweep, and gives up all jobs if one
fails. This one waits for the result file of every job. It asks ``squeue``, which the controller itself answers, for
jobs that end without one.

A job receives its configuration as plain data. It only needs the same Python environment, data and plugin files, and
writes its rows to a part of its own under the output folder. If a job is killed, the view in work and the rows of the
last third of a second are lost. The same command then does these views again.
"""

from __future__ import annotations

import io
import os
import pickle
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sucre_bench import plugins, results
from sucre_bench.engine.preflight import base_row, plan
from sucre_bench.engine.score import row_without_value
from sucre_bench.engine.workers import run_jobs
from sucre_bench.errors import DiskFullError, InputError, PluginError, StopRequest, one_line
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.run_options import Slurm
from sucre_bench.machine import progress
from sucre_bench.results.layout import file_name

# Named alike by submitit for every kind of queue; what else there is of sbatch's gets a prefix.
_COMMON = {"timeout_min", "cpus_per_task", "mem_gb", "gpus_per_node", "name"}
_OURS = {"latency_s", "submitit_folder"}
# What starts threads, and reads how many when it is loaded.
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")
_USUAL_MAX_ARRAY = 1001  # slurm.conf(5)
_TIMEOUT_S = 60  # of a question to the controller
_SETTLE_S = 5.0  # a job has its result some time before SLURM calls it ended
_CANCEL_S = 15.0  # SLURM's own patience with what it ends is 30 s (KillWait)
_SAY_S = 30.0  # between two lines

# What became of a job without a result, by the final states of squeue(1); "" when the queue does not list it.
_ENDED = {
    "BOOT_FAIL": "its node did not start",
    "CANCELLED": "was cancelled",
    "COMPLETED": "ended without a result",
    "DEADLINE": "was killed",
    "FAILED": "was killed",
    "NODE_FAIL": "its node failed",
    "OUT_OF_MEMORY": "ran out of memory; give more with hydra.launcher.mem_gb=",
    "PREEMPTED": "had to make room for others",
    "REVOKED": "was killed",
    "TIMEOUT": "reached its time limit; give hydra.launcher.timeout_min= or more shards",
    "": "is not known to SLURM any more",
}


@dataclass(frozen=True)
class Submitted:
    """A job in the queue: its id ("12", or "12_3" in an array), the file it leaves its result in, and its log."""

    id: str
    result: Path
    log: Path

    @property
    def array(self) -> str:
        """The id of its array; of a single job, its own."""
        return self.id.partition("_")[0]


def launch(jobs: Sequence[Job], options: Slurm) -> None:
    """Submit jobs, wait for all of them, and report those that were lost; their rows say how each ended.

    Raises InputError before it submits any, PluginError if the queue refuses them.
    """
    place = "hydra/launcher=slurm"
    if not all(shutil.which(name) for name in ("sbatch", "squeue", "scancel", "srun")):
        raise InputError("no sbatch here", place, "give the command on a login node of the cluster")
    if job_states() is None:
        raise InputError("squeue gets no answer from the controller", place, "try again when it runs")
    folder = Path(options.submitit_folder.replace("${out}", str(jobs[0].out))).absolute()
    folder.mkdir(parents=True, exist_ok=True)
    earlier = {path.name.partition("_")[0] for path in folder.glob("*_submission.sh")}
    if both := " ".join(sorted(_at_work(earlier, _SETTLE_S))):  # they would do the same work
        fault = f"SLURM job {both} of an earlier command is not done"
        raise InputError(fault, folder, f"wait for it, or end it with `scancel {both}`")
    submitted: list[Submitted] = []
    try:
        _submit(jobs, folder, options, submitted)
        _wait(jobs, folder, submitted, options.latency_s)
    except BaseException:
        if arrays := sorted({job.array for job in submitted}):
            progress.say(f"cancelling SLURM job {', '.join(arrays)}; finished results stay")
            _answer("scancel", *arrays)  # SIGTERM comes first, SIGKILL a little later
            _at_work(arrays, _CANCEL_S)
        raise


def _submit(jobs: Sequence[Job], folder: Path, options: Slurm, submitted: list[Submitted]) -> None:
    """Submit jobs in arrays as large as SLURM takes, noting each in `submitted` at once."""
    from submitit import AutoExecutor

    cpus, given = options.cpus_per_task, dict(vars(options))
    given["signal_delay_s"] = min(options.signal_delay_s, 15 * options.timeout_min)
    given["setup"] = [*(f"export {name}={cpus}" for name in _THREADS), *options.setup]
    given["srun_args"] = [f"--cpus-per-task={cpus}"]  # srun does not take over sbatch's, since SLURM 22.05
    of_executor = {name: value for name, value in given.items() if value is not None and name not in _OURS}
    named = {name if name in _COMMON else f"slurm_{name}": value for name, value in of_executor.items()}
    executor = AutoExecutor(folder, cluster="slurm", slurm_max_num_timeout=0)
    executor.update_parameters(**named, slurm_wckey=None)  # submitit's default is not known to every cluster
    most = largest_array()
    for start in range(0, len(jobs), most):
        array = jobs[start : start + most]
        try:
            with _in_no_job():
                queued = executor.map_array(work, [job.values for job in array], [job.shared_pairs for job in array])
        except Exception as fault:  # sbatch's refusal, in its words
            lines = [line.strip() for line in str(fault).splitlines() if "error" in line] or [one_line(fault)]
            raise PluginError(f"SLURM took {len(submitted)} of {len(jobs)} jobs; {lines[0]}") from fault
        submitted += [Submitted(job.job_id, job.paths.result_pickle, job.paths.stderr) for job in queued]


def _wait(jobs: Sequence[Job], folder: Path, submitted: Sequence[Submitted], latency_s: float) -> None:
    """Wait for all jobs, and write a row for each dataset and method that lost some."""
    job_of = {one.id: job for one, job in zip(submitted, jobs, strict=True)}
    lost: dict[str, list[tuple[Job, str]]] = {}
    progress.say(f"SLURM job {', '.join(dict.fromkeys(one.array for one in submitted))}: logs in {folder}")
    with progress.line(f"{len(jobs)} jobs on SLURM", len(jobs)) as after_job:
        for ended, fault in wait(submitted, job_states, latency_s):
            after_job()
            if not fault:
                for handed_over in (ended.result, folder / f"{ended.id}_submitted.pkl"):
                    handed_over.unlink(missing_ok=True)
                continue
            job = job_of[ended.id]
            name = f"{job.dataset.label} / {job.method.label}"
            shard = f" (shard {job.shard.index} of {job.shard.count})" if job.shard.count > 1 else ""
            reason = f"SLURM job {ended.id}{shard} {fault}"
            progress.say(f"failed  {name}: {reason}", is_fault=True)
            lost.setdefault(name, []).append((job, reason))
    for (job, reason), *others in lost.values():
        more = f"; and {len(others)} more of its jobs" if others else ""
        row = row_without_value(base_row(job), "failed", reason + more)
        results.write_rows(job.out, file_name(f"{job.dataset.label}-{job.method.label}"), [row])


@contextmanager
def _in_no_job() -> Iterator[None]:
    """Unset SLURM's variables, in case this process runs in a job; what users tell sbatch (SBATCH_...) stays."""
    prefixes = ("SLURM_", "SLURMD_", "SRUN_", "SUBMITIT_")
    hidden = {name: os.environ[name] for name in os.environ if name.startswith(prefixes) and name != "SLURM_CONF"}
    for name in hidden:
        del os.environ[name]
    try:
        yield
    finally:
        os.environ.update(hidden)


# -- the queue ---------------------------------------------------------------------------------------------


def job_states() -> dict[str, str] | None:
    """Return the state of each of this user's jobs by its id, "12" or "12_3" in an array; None without an answer.

    A job that ended stays listed for a while (MinJobAge in slurm.conf, 5 minutes by default).
    """
    listed = ("--noheader", "--array", "--states=all", "--format=%i|%T")
    answer = _answer("squeue", f"--user={os.getuid()}", *listed)
    if answer is None:
        return None
    return {job.strip(): state.strip() for job, _, state in (line.partition("|") for line in answer.splitlines())}


def _at_work(arrays: Collection[str], patience_s: float) -> set[str]:
    """Return those of some arrays and single jobs that have not ended, after waiting for them for so many seconds."""
    until = time.monotonic() + patience_s
    while True:
        states = job_states() or {}
        left = {job.partition("_")[0] for job, state in states.items() if state not in _ENDED}.intersection(arrays)
        if not left or time.monotonic() > until:
            return left
        time.sleep(0.5)


def largest_array() -> int:
    """Return how many jobs one array may hold here; 1 where arrays are switched off."""
    found = re.search(r"^MaxArraySize\s*=\s*(\d+)", _answer("scontrol", "show", "config") or "", re.MULTILINE)
    return max(1, int(found[1])) if found else _USUAL_MAX_ARRAY


def _answer(*command: str) -> str | None:
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=_TIMEOUT_S).stdout
    except (OSError, subprocess.SubprocessError):
        return None


def wait(
    jobs: Sequence[Submitted],
    states: Callable[[], dict[str, str] | None],
    latency_s: float,
    *,
    look_s: float = 1.0,
    ask_s: float = 30.0,
) -> Iterator[tuple[Submitted, str]]:
    """Yield each job as it ends, with what went wrong: nothing where it left a result that says so.

    states: the queue's word on every job it knows, None while it gives no answer, which says nothing about any job;
    latency_s: most seconds until a result is visible after its job has ended; look_s: seconds between two looks for
    results; ask_s: most seconds between two questions to the queue. Controllers of large sites should not be asked more
    often. A job that the queue starts anew (after its node failed, say) is waited for again.
    """
    left, last, ended_at = {job.id: job for job in jobs}, dict[str, str](), dict[str, float]()
    started, asked, said, said_at = time.monotonic(), float("-inf"), "", float("-inf")
    while left:
        there: set[Path] = set()
        for folder in {job.result.parent for job in left.values()}:
            with suppress(OSError):  # a listing is what a network file system answers from the server
                there.update(folder.iterdir())
        for job in [job for job in left.values() if job.result in there]:
            del left[job.id]
            yield job, _fault_in_result(job)
        now = time.monotonic()
        if left and now - asked > min((now - started) / 10, ask_s):
            answer, asked = states(), now
            if answer is None:
                time.sleep(look_s)
                continue
            for id_ in left:
                before = last.get(id_, "")
                last[id_] = answer.get(id_, before if before in _ENDED else "")
                if last[id_] in _ENDED:
                    ended_at.setdefault(id_, now)
                else:
                    ended_at.pop(id_, None)
            waiting = sum(last[id_] == "PENDING" for id_ in left)
            counts = f"{waiting} waiting, {len(left) - waiting} at work, {len(jobs) - len(left)} ended"
            if counts != said and now - said_at > _SAY_S:
                said, said_at = counts, now
                progress.say(f"SLURM: {counts}")
        for job in [job for job in left.values() if now - ended_at.get(job.id, now) > latency_s]:
            del left[job.id]
            state = last[job.id]
            line = _last_line(job.log.read_text(errors="replace")) if job.log.is_file() else ""
            details = [state, line if state in ("FAILED", "COMPLETED") else ""]
            detail = f" ({', '.join(filter(None, details))})" if state else ""
            yield job, f"{_ENDED[state]}{detail}; log: {job.log}"
        if left:
            time.sleep(look_s)


class _Words(pickle.Unpickler):
    """Reads what submitit's jobs leave, a pair of texts; anything that would run code is refused."""

    def find_class(self, module: str, name: str) -> None:
        raise pickle.UnpicklingError(f"holds {module}.{name}, not only text")


def _fault_in_result(job: Submitted) -> str:
    try:
        outcome, text = _Words(io.BytesIO(job.result.read_bytes())).load()
    except Exception as fault:  # whatever an unreadable pickle raises
        return f"left a result that cannot be read ({type(fault).__name__}); log: {job.log}"
    if outcome == "success":
        return str(text or "")
    return f"failed, {_last_line(str(text)) or outcome}; log: {job.log}"


def _last_line(text: str) -> str:
    return next((line.strip() for line in reversed(text.splitlines()) if line.strip()), "")[:160]


# -- in a job ----------------------------------------------------------------------------------------------


class _TimeIsUp(StopRequest):
    """The queue's warning before it ends a job; no fault of a method, so nothing may take it for one."""


def work(values: Mapping[str, Any], shared_pairs: str) -> str:
    """Run one job of a sweep in a job of the queue; return why it stopped early, if it did.

    values, shared_pairs: of a `Job`. Its plugin files are loaded.

    Both of SLURM's signals end the work as Ctrl-C would, with every row written. The warning before the time limit
    gives a result that says so. SIGTERM gives none, since it may also mean that the job will start again.
    """
    from submitit import JobEnvironment

    def time_is_up(*_: object) -> None:
        raise _TimeIsUp

    # submitit's own would raise an error that looks like the method's, and go on.
    signal.signal(getattr(signal, f"SIG{JobEnvironment.USR_SIG}"), time_is_up)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with progress.live(plain=True):
            for file in values["plugins"]:
                plugins.load_file(file)
            job = replace(Job.of(values), shared_pairs=shared_pairs)
            run_jobs([plan(job)], job.workers)
    except _TimeIsUp:
        return _ENDED["TIMEOUT"]
    except DiskFullError as fault:
        return str(fault)
    return ""
