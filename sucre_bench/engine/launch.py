"""Hands the jobs of a command to its launcher, and runs jobs again that were lost when another job crashed.

A launcher is the class that `hydra.launcher` names: `OneByOne`, the one for SLURM, or any of Hydra's. Hydra's own
launchers get each job as text and run `run_text` with it in another process.
"""

from __future__ import annotations

import errno
import logging
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from enum import Enum
from multiprocessing import get_context
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Protocol

from sucre_bench import results
from sucre_bench.engine.failed_rows import failed_row
from sucre_bench.engine.preflight import Planned, states
from sucre_bench.engine.run_job import run_job
from sucre_bench.errors import DiskFullError, PluginError, SucreBenchError, one_line
from sucre_bench.jobs.compose_jobs import Command
from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress, progress_display
from sucre_bench.machine.current_step import Note, NoteFile, at_work
from sucre_bench.machine.supervisor import how_it_ended
from sucre_bench.machine.traceback_log import keep_traceback
from sucre_bench.results.layout import at_work_path, file_name, log_path
from sucre_bench.results.table import FLUSH_S

if TYPE_CHECKING:
    from hydra.plugins.launcher import Launcher as HydraLauncher
    from omegaconf import DictConfig


class Ended(Enum):
    """How a launcher came back; what each job did is in the rows."""

    WELL = "well"
    WORKER_DIED = "worker died"
    CRASHED = "crashed"


class Launcher(Protocol):
    """Runs jobs."""

    def launch(self, jobs: Sequence[Job], restorations: int) -> None:
        """Run the jobs and return when all have ended. restorations: how many views all of them will do."""


def launch(command: Command, restorations: int) -> Ended:
    """Run the jobs of a command; return how that ended. restorations: how many views all jobs will do.

    Raises DiskFullError, without the jobs that are left: none could write.
    """
    from hydra.core.utils import env_override

    try:
        with env_override(dict(command.settings.hydra.job.env_set)):
            _launcher_of(command).launch(command.jobs, restorations)
    except DiskFullError:
        raise
    except BrokenProcessPool:  # a worker of joblib was killed
        keep_traceback(log_path(command.jobs[0].out), "launcher")
        return Ended.WORKER_DIED
    except Exception as fault:  # of a launcher: jobs turn their own faults into rows
        keep_traceback(log_path(command.jobs[0].out), "launcher")
        reason = one_line(fault) if isinstance(fault, SucreBenchError) else one_line(fault)[:160]
        remedy = "; free /dev/shm, or leave out hydra/launcher=" * _is_shared_memory_full(command, fault)
        progress.say(f"failed  the launcher: {reason}{remedy}", is_fault=True)
        return Ended.CRASHED
    return Ended.WELL


def _is_shared_memory_full(command: Command, fault: Exception) -> bool:
    """Whether joblib found no room for what its workers share."""
    is_full = isinstance(fault, OSError) and fault.errno == errno.ENOSPC
    return is_full and command.is_sweep and "joblib" in command.settings.hydra.launcher.get("_target_", "")


def _launcher_of(command: Command) -> Launcher:
    """Make the launcher that the command names; a single job needs none of Hydra's."""
    from hydra.plugins.launcher import Launcher as HydraLauncher
    from hydra.utils import instantiate
    from omegaconf import OmegaConf

    if not command.is_sweep:
        return OneByOne()
    settings = OmegaConf.to_container(command.settings.hydra.launcher, resolve=True)
    launcher = instantiate(settings, _convert_="all")
    return _ThroughHydra(launcher, command.settings) if isinstance(launcher, HydraLauncher) else launcher


class OneByOne:
    """Runs jobs in this process, one after the other."""

    def launch(self, jobs: Sequence[Job], restorations: int) -> None:
        """Run the jobs. A fault that ends one of them is raised when all have run."""
        if len(jobs) == 1:
            _run(jobs[0])
            return
        faults: list[Exception] = []
        with progress.line(f"{len(jobs)} jobs", restorations) as step:
            for job in jobs:
                try:
                    _run(job, step)
                except DiskFullError:
                    raise
                except Exception as fault:
                    faults.append(fault)
        if faults:
            raise faults[0]


@dataclass(frozen=True)
class _ThroughHydra:
    """Hands jobs to a launcher of Hydra's, as text: what it takes for the overrides of a job is `[config, pairs]`."""

    launcher: HydraLauncher
    settings: DictConfig

    def launch(self, jobs: Sequence[Job], restorations: int) -> None:
        """Run the jobs where the launcher runs them."""
        from hydra.experimental.callback import Callback
        from hydra.types import HydraContext

        context = HydraContext(config_loader=_Composed(), callbacks=Callback())  # type: ignore[arg-type]
        self.launcher.setup(hydra_context=context, task_function=_task, config=self.settings)
        with _same_log_level(), _warnings_as_lines():
            for ended in self.launcher.launch([[job.config, job.shared_pairs] for job in jobs], 0):
                if isinstance(fault := ended.return_value, DiskFullError):  # raises what else ended the job
                    raise fault


@contextmanager
def _same_log_level() -> Iterator[None]:
    """Hydra's launchers set the level of the log of the whole process; it is put back."""
    level = logging.root.level
    try:
        yield
    finally:
        logging.root.setLevel(level)


@contextmanager
def _warnings_as_lines() -> Iterator[None]:
    """What joblib warns of, for example that it has no shared memory, is a line without paths and code."""

    def shown(message: Warning | str, *_: object, **__: object) -> None:
        progress.say(f"hydra/launcher: {' '.join(str(message).split())}")

    with warnings.catch_warnings():
        warnings.showwarning = shown
        yield


class _Composed:
    """Gives Hydra's launchers jobs that are composed already."""

    def load_sweep_config(self, settings: DictConfig, job: Sequence[str]) -> DictConfig:
        """Return what a launcher needs to know, and the job's text. settings: of the sweep."""
        from omegaconf import OmegaConf

        return OmegaConf.create({"out": settings.out, "hydra": settings.hydra, "job": list(job)})


def _task(settings: DictConfig) -> DiskFullError | None:
    """Run a job. A full disk is returned: Hydra would print lines about an exception, for each job."""
    from omegaconf import OmegaConf

    job: Any = OmegaConf.to_container(settings.job, resolve=False)
    try:
        run_text(*job)
    except DiskFullError as fault:
        return fault
    return None


def run_text(
    config: str,
    shared_pairs: str = "",
    flush_s: float = FLUSH_S,
    deaths: Mapping[str, str] = MappingProxyType({}),
    start: str = "",
) -> None:
    """Run a job in a process of its own, which shows no progress. config, shared_pairs: of a `Job`.

    The process notes its steps in a file of the output folder, which stays if it dies. deaths, start: see
    `machine.current_step.at_work`.
    """
    with progress_display.plain():
        job = replace(Job.read(config), shared_pairs=shared_pairs)
        path = at_work_path(job.out, config)
        file = NoteFile.at(path)
        try:
            with at_work(file, deaths, start):
                _run(job, flush_s=flush_s)
        finally:
            file.close()
            _remove_note(path)


def _run(job: Job, after_view: Callable[[], None] = lambda: None, flush_s: float = FLUSH_S) -> None:
    try:
        run_job(job, after_view, flush_s)
    except DiskFullError:
        raise
    except SucreBenchError as fault:
        progress.say(f"failed  {job.dataset.label} / {job.method.label}: {fault}", is_fault=True)


def rescue(planned: Sequence[Planned], started: str) -> None:
    """Run what is left undone after a worker of this machine died, each job in a process of its own.

    A view or score that ends its process again gets a row that says so, and the job goes on in the next process.
    """
    for plan in planned:  # all workers end with one: the notes of the others say nothing
        _remove_note(at_work_path(plan.job.out, plan.job.config))
    progress.say("a worker process died; its unfinished jobs run again, each in a process of its own")
    for plan in planned:
        rows = results.merge(plan.job.out)
        if all(state.status != "missing" for state in states(rows, plan, started)):
            continue
        _run_alone(plan.job, started)


def _run_alone(job: Job, started: str) -> None:
    """Run a job in a process of its own; if that dies at a step, in the next, without the step."""
    path, deaths = at_work_path(job.out, job.config), dict[str, str]()
    while (status := _status_of(job, deaths, started)) != 0:
        note = _left_note(path)
        how = how_it_ended(status, note)
        if not note.step or note.step in deaths:
            fault = PluginError(f"the job's process died ({how}); try smaller images")
            results.write_rows(job.out, file_name(job.method.label), [failed_row(job, fault)])
            return
        deaths[note.step] = how


def _status_of(job: Job, deaths: dict[str, str], started: str) -> int:
    """Run a job in a new process; return its exit code, or minus the number of the signal that ended it."""
    # Every view is written at once: the next one may end the process.
    arguments = (job.config, job.shared_pairs, 0.0, deaths, started)
    process = get_context("spawn").Process(target=run_text, args=arguments)
    process.start()
    try:
        process.join()
    finally:
        if process.is_alive():
            process.terminate()
            process.join()
    assert process.exitcode is not None
    return process.exitcode


def _left_note(path: Path) -> Note:
    """Take the note that a process has left."""
    file = NoteFile.at(path)
    note = file.read()
    file.close()
    _remove_note(path)
    return note


def _remove_note(path: Path) -> None:
    path.unlink(missing_ok=True)
    with suppress(OSError):  # another job is at work
        path.parent.rmdir()
