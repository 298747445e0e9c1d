"""Handing the jobs of a command to its launcher, and what to do if a job takes others down with it.

A launcher is the class that `hydra.launcher` names: `OneByOne`, the one for SLURM, or any of Hydra's. Hydra's own
launchers get each job as text and run `run_text` with it in another process.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from enum import Enum
from multiprocessing import get_context
from typing import TYPE_CHECKING, Any, Protocol

from sucre_bench import results
from sucre_bench.engine.preflight import Planned, states
from sucre_bench.engine.run_job import failed_row, run_job
from sucre_bench.errors import PluginError, SucreBenchError, one_line
from sucre_bench.jobs.command import Command
from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress, terminal
from sucre_bench.machine.log import keep_traceback
from sucre_bench.results.layout import file_name, log_path
from sucre_bench.results.table import FLUSH_S

if TYPE_CHECKING:
    from hydra.plugins.launcher import Launcher as HydraLauncher
    from omegaconf import DictConfig

__all__ = ["Ended", "Launcher", "OneByOne", "launch", "rescue", "run_text"]


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
    """Run the jobs of a command; return how that ended. restorations: how many views all jobs will do."""
    from hydra.core.utils import env_override

    try:
        with env_override(dict(command.settings.hydra.job.env_set)):
            _launcher_of(command).launch(command.jobs, restorations)
    except BrokenProcessPool:  # a worker of joblib was killed
        keep_traceback(log_path(command.jobs[0].out), "launcher")
        return Ended.WORKER_DIED
    except Exception as fault:  # of a launcher: jobs turn their own faults into rows
        keep_traceback(log_path(command.jobs[0].out), "launcher")
        reason = one_line(fault) if isinstance(fault, SucreBenchError) else one_line(fault)[:160]
        progress.say(f"failed  the launcher: {reason}")
        return Ended.CRASHED
    return Ended.WELL


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
        for ended in self.launcher.launch([[job.config, job.shared_pairs] for job in jobs], 0):
            _ = ended.return_value  # raises what ended the job


class _Composed:
    """Gives Hydra's launchers jobs that are composed already."""

    def load_sweep_config(self, settings: DictConfig, job: Sequence[str]) -> DictConfig:
        """Return what a launcher needs to know, and the job's text. settings: of the sweep."""
        from omegaconf import OmegaConf

        return OmegaConf.create({"out": settings.out, "hydra": settings.hydra, "job": list(job)})


def _task(settings: DictConfig) -> None:
    from omegaconf import OmegaConf

    job: Any = OmegaConf.to_container(settings.job, resolve=False)
    run_text(*job)


def run_text(config: str, shared_pairs: str = "", flush_s: float = FLUSH_S) -> None:
    """Run a job in a process of its own, which shows no progress. config, shared_pairs: of a `Job`."""
    with terminal.plain():
        _run(replace(Job.read(config), shared_pairs=shared_pairs), flush_s=flush_s)


def _run(job: Job, after_view: Callable[[], None] = lambda: None, flush_s: float = FLUSH_S) -> None:
    try:
        run_job(job, after_view, flush_s)
    except SucreBenchError as fault:
        progress.say(f"failed  {job.dataset.label} / {job.method.label}: {fault}")


def rescue(planned: Sequence[Planned], started: str) -> None:
    """Run what is left undone after a worker of this machine died, each job in a process of its own.

    A job that kills its process again gets a row that says so; the views it did before and the other jobs are kept.
    """
    progress.say("a worker process died; what it left undone runs again, each job in a process of its own")
    for plan in planned:
        rows = results.merge(plan.job.out)
        if all(state.status != "missing" for state in states(rows, plan, started)):
            continue
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as alone:
            try:
                # Every view is written at once: the next one may kill the process.
                alone.submit(run_text, plan.job.config, plan.job.shared_pairs, 0.0).result()
            except BrokenProcessPool:
                fault = PluginError("the job's process was killed, for want of memory perhaps; try smaller images")
                part = results.Part(plan.job.out, file_name(plan.job.method.label))
                part.add([failed_row(plan.job, fault)])
                part.flush()
