"""The sweeper and the launcher of `sucre-bench run -m`.

Hydra imports this module in each of its programs, so the package is imported where it is needed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from contextvars import copy_context
from threading import Event, Thread
from typing import Any

from hydra._internal.core_plugins.basic_launcher import BasicLauncher
from hydra.core.plugins import Plugins
from hydra.core.utils import JobReturn, JobStatus
from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig

_TICK_S = 0.5


class WorkersLauncher(BasicLauncher):
    """All jobs on this machine, `workers` at a time. Under another sweeper, one job after the other."""


class PairSweeper(Sweeper):
    """Every dataset with every method: all jobs are checked before the first one runs."""

    # What the command asks for, and what follows it.
    asked: Any = None
    watch: Any = None

    def __init__(self, **listed: Any) -> None:
        self.listed = listed  # in the configuration, where composing finds them

    def setup(
        self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig
    ) -> None:
        """Make the launcher."""
        self.context = hydra_context
        self.launcher: Any = Plugins.instance().instantiate_launcher(
            hydra_context=hydra_context, task_function=task_function, config=config
        )

    def sweep(self, arguments: list[str]) -> Any:
        """Run the jobs of a command, and return the outcome of all."""
        from sucre_bench.engine.hydra_run import run_as_job
        from sucre_bench.engine.run import run
        from sucre_bench.jobs.compose_jobs import command_of

        command = command_of(self.asked)
        if isinstance(self.launcher, WorkersLauncher):
            return run_as_job(command, self.context, self.watch)[0]
        return run(command, self.watch, self._launch)

    def _launch(self, overrides: Sequence[tuple[str, ...]]) -> list[str]:
        """Let a launcher run jobs, and return why each was lost, empty for one that was not."""
        # jobs of the basic launcher work in this process, and tick
        with nullcontext() if isinstance(self.launcher, BasicLauncher) else _ticking():
            returns: Sequence[JobReturn] = self.launcher.launch(
                [[*words] for words in overrides], initial_job_idx=0
            )
        return [_reason(one) for one in returns]


@contextmanager
def _ticking() -> Iterator[None]:
    """Show the command's progress while a launcher blocks it; what follows the command is heard then."""
    from sucre_bench.machine import progress

    context, has_ended = copy_context(), Event()

    def tick() -> None:
        while not has_ended.wait(_TICK_S):
            progress.show("tick")

    thread = Thread(target=context.run, args=(tick,), daemon=True)
    thread.start()
    try:
        yield
    finally:
        has_ended.set()
        thread.join()


def _reason(returned: JobReturn) -> str:
    from sucre_bench.errors import one_line

    if returned.status == JobStatus.COMPLETED:
        return ""
    return one_line(returned._return_value)[:160]  # noqa: SLF001
