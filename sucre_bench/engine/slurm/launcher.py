"""The launcher for SLURM: a job of the queue for every job of a sweep, and one report at the end.

A job receives its configuration as text; it only needs the same Python environment, data and plugin files. It writes
its rows to a part of its own under the output folder. A killed job loses only the view it was at, and the same command
does what is left.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sucre_bench import results
from sucre_bench.engine.job import JobAtWork
from sucre_bench.engine.preflight import plan
from sucre_bench.engine.score import row_without_value
from sucre_bench.engine.select_views import base_row
from sucre_bench.engine.slurm import squeue
from sucre_bench.engine.slurm.waiting import WORDS, Submitted, Teller, wait
from sucre_bench.engine.workers import run_works
from sucre_bench.errors import DiskFullError, InputError, PluginError, StopRequest, one_line
from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress
from sucre_bench.results.layout import file_name

if TYPE_CHECKING:
    from submitit import Executor

# Named alike by submitit for every kind of queue; what else there is of sbatch's gets a prefix.
_COMMON = {"timeout_min", "cpus_per_task", "mem_gb", "gpus_per_node", "name"}
# What starts threads, and reads how many when it is loaded.
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")


class Launcher:
    """Submits jobs, waits for all of them, and reports those that were lost. Options: see `jobs.slurm_settings`."""

    def __init__(self, submitit_folder: str, latency_s: float, **asked: Any) -> None:
        self._folder = Path(submitit_folder).absolute()
        self._latency_s = latency_s
        self._asked = asked

    def launch(self, jobs: Sequence[Job]) -> None:
        """Run the jobs; their rows say how each ended.

        Raises InputError before it submits any, PluginError if the queue refuses them.
        """
        squeue.check_is_there()
        self._folder.mkdir(parents=True, exist_ok=True)
        _check_nobody_works(self._folder)
        submitted: list[Submitted] = []
        try:
            self._submit(jobs, submitted)
            self._wait(jobs, submitted)
        except BaseException:
            _cancel(submitted)
            raise

    def _submit(self, jobs: Sequence[Job], submitted: list[Submitted]) -> None:
        """Submit jobs in arrays as large as SLURM takes, noting each in `submitted` at once."""
        executor, most = self._executor(), squeue.largest_array()
        for start in range(0, len(jobs), most):
            array = jobs[start : start + most]
            configurations, pairs = [job.config for job in array], [job.shared_pairs for job in array]
            try:
                with _in_no_job():
                    queued = executor.map_array(work, configurations, pairs)
            except Exception as fault:  # sbatch's refusal, in its words
                taken = f"SLURM took {len(submitted)} of {len(jobs)} jobs"
                raise PluginError(f"{taken}; {_refusal(fault)}") from fault
            for job in queued:
                paths = job.paths
                submitted.append(Submitted(job.job_id, paths.result_pickle, paths.stdout, paths.stderr))

    def _executor(self) -> Executor:
        from submitit import AutoExecutor

        asked = dict(self._asked)
        cpus = asked["cpus_per_task"]
        asked["signal_delay_s"] = min(asked["signal_delay_s"], 15 * asked["timeout_min"])
        asked["setup"] = [*(f"export {name}={cpus}" for name in _THREADS), *asked["setup"]]
        asked["srun_args"] = [f"--cpus-per-task={cpus}"]  # srun does not take over sbatch's, since SLURM 22.05
        executor = AutoExecutor(self._folder, cluster="slurm", slurm_max_num_timeout=0)
        given = {name: value for name, value in asked.items() if value is not None}
        named = {name if name in _COMMON else f"slurm_{name}": value for name, value in given.items()}
        executor.update_parameters(**named, slurm_wckey=None)  # submitit's default is not known to every cluster
        return executor

    def _wait(self, jobs: Sequence[Job], submitted: Sequence[Submitted]) -> None:
        job_of = {one.id: job for one, job in zip(submitted, jobs, strict=True)}
        lost: dict[str, list[tuple[Job, str]]] = {}
        ids = ", ".join(dict.fromkeys(squeue.array_of(one.id) for one in submitted))
        progress.say(f"SLURM job {ids}: logs in {self._folder}")
        with progress.line(f"{len(jobs)} jobs on SLURM", len(jobs)) as step:
            for ended, fault in wait(submitted, squeue.states, self._latency_s, Teller(jobs[0].out)):
                if fault:
                    job = job_of[ended.id]
                    name = f"{job.dataset.label} / {job.method.label}"
                    shard = f" (shard {job.shard.index} of {job.shard.count})" if job.shard.count > 1 else ""
                    reason = f"SLURM job {ended.id}{shard} {fault}"
                    progress.say(f"failed  {name}: {reason}", is_fault=True)
                    lost.setdefault(name, []).append((job, reason))
                else:
                    for handed_over in (ended.result, self._folder / f"{ended.id}_submitted.pkl"):
                        handed_over.unlink(missing_ok=True)
                step()
        for (job, reason), *others in lost.values():
            more = f"; and {len(others)} more of its jobs" if others else ""
            row = row_without_value(base_row(job), "failed", reason + more)
            results.write_rows(job.out, file_name(f"{job.dataset.label}-{job.method.label}"), [row])


@contextmanager
def _in_no_job() -> Iterator[None]:
    """Hide what SLURM says of the job that this process may itself be in; what users tell sbatch (SBATCH_...) stays."""
    hidden = ("SLURM_", "SLURMD_", "SRUN_", "SUBMITIT_")
    of_ours = {name: os.environ[name] for name in os.environ if name.startswith(hidden) and name != "SLURM_CONF"}
    for name in of_ours:
        del os.environ[name]
    try:
        yield
    finally:
        os.environ.update(of_ours)


def _refusal(fault: Exception) -> str:
    told = [line for line in str(fault).splitlines() if "error" in line]
    return told[0].strip() if told else one_line(fault)


def _check_nobody_works(folder: Path) -> None:
    """Raise InputError while jobs of an earlier command are in the queue: they would do the same work."""
    earlier = {path.name.partition("_")[0] for path in folder.glob("*_submission.sh")}
    if both := sorted(earlier & {squeue.array_of(job) for job in squeue.at_work()}):
        raise InputError(
            f"{folder}: SLURM job {', '.join(both)} of an earlier command is not done; "
            f"wait for it, or end it with `scancel {' '.join(both)}`"
        )


def _cancel(submitted: Sequence[Submitted]) -> None:
    """Cancel what is still in the queue, and give it a while to write down what it has."""
    arrays = sorted({squeue.array_of(one.id) for one in submitted})
    if arrays:
        progress.say(f"cancelling SLURM job {', '.join(arrays)}; finished results stay")
        squeue.cancel(arrays)


class _TimeIsUp(StopRequest):
    """The queue's warning before it ends a job; no fault of a method, so nothing may take it for one."""


def work(config: str, shared_pairs: str) -> str:
    """Run one job of a sweep in a job of the queue; return why it stopped early, if it did.

    config, shared_pairs: of a `Job`.

    Both of SLURM's signals end the work as Ctrl-C would, with every row written. The warning before the time limit
    gives a result that says so. SIGTERM gives none, since it may also mean that the job will start again.
    """
    from submitit import JobEnvironment

    def time_is_up(*_: object) -> None:
        raise _TimeIsUp

    def terminated(*_: object) -> None:
        raise KeyboardInterrupt

    # submitit's own would raise an error that looks like the method's, and go on.
    signal.signal(getattr(signal, f"SIG{JobEnvironment.USR_SIG}"), time_is_up)
    signal.signal(signal.SIGTERM, terminated)
    try:
        with progress.live(plain=True):
            job = replace(Job.read(config), shared_pairs=shared_pairs)
            run_works([JobAtWork(plan(job))], job.workers)
    except _TimeIsUp:
        return WORDS["TIMEOUT"]
    except DiskFullError as fault:
        return str(fault)
    return ""
