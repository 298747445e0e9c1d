"""Hands the jobs of a command to its launcher.

A launcher is the class that `hydra.launcher` names: `OneByOne`, the one for SLURM, or any of Hydra's. Hydra's own
launchers get each job as text and run `run_text` with it in another process.
"""

from __future__ import annotations

import errno
import logging
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any, Protocol

from sucre_bench.engine.job_process import run_text
from sucre_bench.engine.run_job import run_job
from sucre_bench.errors import DiskFullError, SucreBenchError, one_line
from sucre_bench.jobs.compose_jobs import Command
from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress
from sucre_bench.machine.records import keep_traceback
from sucre_bench.results.layout import log_path

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
            run_job(jobs[0])
            return
        faults: list[Exception] = []
        with progress.line(f"{len(jobs)} jobs", restorations) as step:
            for job in jobs:
                try:
                    run_job(job, step)
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
