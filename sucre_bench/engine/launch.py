"""Running the jobs of a sweep through Hydra's launchers, and what to do when one takes others with it."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext
from contextvars import ContextVar
from enum import Enum
from multiprocessing import get_context
from typing import TYPE_CHECKING

from sucre_bench import plugins, results
from sucre_bench.engine.preflight import Planned, states
from sucre_bench.engine.run_job import failed_row, run_job
from sucre_bench.errors import PluginError, SucreBenchError, one_line
from sucre_bench.jobs.command import Sweep
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.schema import CONF
from sucre_bench.machine import progress, terminal
from sucre_bench.machine.log import keep_traceback
from sucre_bench.results.layout import file_name, log_path

if TYPE_CHECKING:
    from omegaconf import DictConfig

__all__ = ["Ended", "launch", "rescue"]


class Ended(Enum):
    """How a launcher came back; what each job did is in the rows."""

    WELL = "well"
    WORKER_DIED = "worker died"
    CRASHED = "crashed"


# Steps the line of the whole sweep; None in the processes of a parallel launcher, which each tell of their own job.
_view_done: ContextVar[Callable[[], None] | None] = ContextVar("view_done", default=None)


def launch(sweep: Sweep, restorations: int) -> Ended:
    """Hand the command to Hydra, whose launchers run `_hydra_job` here or elsewhere; return how that ended."""
    import hydra

    arguments = [*sweep.overrides, *sweep.told, *(["--multirun"] if sweep.multirun else [])]
    main = hydra.main(config_path=f"pkg://{CONF}", config_name="config", version_base="1.3")(_hydra_job)
    with _as_command_line(["sucre-bench run", *arguments]):
        return _run_main(main, sweep, restorations)


@contextmanager
def _as_command_line(arguments: list[str]) -> Iterator[None]:
    """Let Hydra read its command from where it looks, and raise what it trips over instead of printing it."""
    before, sys.argv = sys.argv, arguments
    full = os.environ.get("HYDRA_FULL_ERROR")
    os.environ["HYDRA_FULL_ERROR"] = "1"
    try:
        yield
    finally:
        sys.argv = before
        del os.environ["HYDRA_FULL_ERROR"]
        if full is not None:
            os.environ["HYDRA_FULL_ERROR"] = full


def _run_main(main: Callable[[], None], sweep: Sweep, restorations: int) -> Ended:
    try:
        if len(sweep.jobs) == 1 or not sweep.in_process:
            main()
        else:
            with progress.line(f"{len(sweep.jobs)} jobs", restorations) as step:
                token = _view_done.set(step)
                try:
                    main()
                finally:
                    _view_done.reset(token)
    except Exception as fault:  # of a launcher: jobs turn their own faults into rows
        keep_traceback(log_path(sweep.jobs[0].out), "launcher")
        if type(fault).__name__ == "TerminatedWorkerError":  # joblib's, of a copy of loky that it hides
            return Ended.WORKER_DIED
        reason = one_line(fault) if isinstance(fault, SucreBenchError) else one_line(fault)[:160]
        progress.say(f"failed  the launcher: {reason}")
        return Ended.CRASHED
    return Ended.WELL


def rescue(planned: Sequence[Planned], started: str) -> None:
    """Run what a dead worker of this machine took with it, each job in a process of its own.

    The job that kills its process again gets a row that says so; the others finish.
    """
    progress.say("a worker process died; what it left undone runs again, each job in a process of its own")
    for plan in planned:
        rows = results.merge(plan.job.out)
        if all(status != "missing" for status, _, _ in states(rows, plan, started)):
            continue
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as alone:
            try:
                alone.submit(_run_alone, plan.job.config).result()
            except BrokenProcessPool:
                fault = PluginError("the job's process was killed, for want of memory perhaps; try smaller images")
                part = results.Part(plan.job.out, file_name(plan.job.method.label))
                part.add([failed_row(plan.job, fault)])
                part.flush()


def _run_alone(configuration: str) -> None:
    import yaml
    from omegaconf import OmegaConf

    _hydra_job(OmegaConf.create(yaml.safe_load(configuration)))


def _hydra_job(settings: DictConfig) -> None:
    for file in settings.plugins:
        plugins.load_file(file)
    job = Job.of(settings)
    with nullcontext() if progress.is_watched() else terminal.plain():
        try:
            run_job(job, _view_done.get() or (lambda: None))
        except SucreBenchError as fault:
            progress.say(f"failed  {job.dataset.label} / {job.method.label}: {fault}")
