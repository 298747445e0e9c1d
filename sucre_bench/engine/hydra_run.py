"""`sucre-bench run` as a program of Hydra: its configuration, callbacks, sweeper and launcher."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from sucre_bench import results
from sucre_bench.engine.run import Outcome, Watch, outcome_of
from sucre_bench.engine.run_config import run_as_job, run_launched
from sucre_bench.errors import InputError, in_one_line
from sucre_bench.jobs import compose_jobs, configs
from sucre_bench.jobs.asked import read, reading_experiment
from sucre_bench.jobs.compose_jobs import Command
from sucre_bench.jobs.words import parse, value_of
from sucre_bench.machine.text_formats import now

if TYPE_CHECKING:
    from hydra._internal.callbacks import Callbacks
    from hydra.types import HydraContext
    from omegaconf import DictConfig


def run_words(words: Sequence[str], multirun: bool, watch: Watch | None = None) -> Outcome:
    """Run what the words of a command ask for.

    Raises InputError for a mistake in the words, and what `engine.run.run` raises.
    """
    from hydra.core.plugins import Plugins
    from hydra.core.utils import configure_log
    from omegaconf import open_dict

    with reading_experiment(words) as words:
        asked = read(words, multirun)
        if asked.config is None:
            return _run_single(compose_jobs.command_of(asked), watch)
        is_ours = asked.config.hydra.runtime.choices["hydra/sweeper"] == "pairs"
        lines = [word.line for word in asked.typed] if is_ours else compose_jobs.lines_of(asked)
        config = asked.config if is_ours else configs.composed(lines, is_sweep=True)
        swept = [*words]
        if not is_ours:  # what all jobs share is not among what tells them apart
            parsed = zip(lines, parse(lines, configs.loader()), strict=True)
            swept = [line for line, word in parsed if word.is_swept]
            shared = [line for line in lines if line not in swept]
            keys = [line.lstrip("+").partition("=")[0] for line in shared]
            unnamed = f"hydra.job.config.override_dirname.exclude_keys={value_of(keys)}"
            with open_dict(config):
                config.hydra.overrides.hydra = [*shared, unnamed]
                config.hydra.overrides.task = swept
        _check_hydra(config)
        configure_log(config.hydra.hydra_logging, config.hydra.verbose)
        context, callbacks = _context(config)
        callbacks.on_multirun_start(config=config, config_name=configs.config_name())
        with configs.faults_of_hydra(lines):
            sweeper: Any = Plugins.instance().instantiate_sweeper(
                config=config, hydra_context=context, task_function=run_launched
            )
            started = now()
            sweeper.watch = watch
            if watch and not is_ours:
                watch.start(compose_jobs.job_of(config))
                watch.before(())
            outcome = sweeper.sweep(arguments=swept)
        callbacks.on_multirun_end(config=config, config_name=configs.config_name())
        return outcome if isinstance(outcome, Outcome) else _outcome_since(started, config)


def _check_hydra(config: DictConfig) -> None:
    """Refuse another working folder, and a launcher of SLURM where no cluster answers. Raises InputError."""
    if config.hydra.job.chdir:
        fault = "paths of a command are relative to the folder where it runs"
        raise InputError(fault, "hydra.job.chdir=true", "leave it out")
    launcher = str(config.hydra.runtime.choices["hydra/launcher"])
    if launcher not in ("slurm", "submitit_slurm"):
        return
    fault = "sbatch is not on this machine"
    if shutil.which("sbatch"):
        asked = subprocess.run(
            ["squeue", "--noheader", f"--user={os.getuid()}"],
            capture_output=True,
            text=True,
            check=False,
            timeout=60,
        )
        if asked.returncode == 0:
            return
        fault = f"no cluster answers squeue: {in_one_line(asked.stderr)}"
    remedy = "start it on a login node of the cluster, or leave the launcher out"
    raise InputError(fault, f"hydra/launcher={launcher}", remedy)


def _context(config: DictConfig) -> tuple[HydraContext, Callbacks]:
    from hydra._internal.callbacks import Callbacks
    from hydra.types import HydraContext

    callbacks = Callbacks(config)
    return HydraContext(config_loader=configs.loader(), callbacks=callbacks), callbacks


def _run_single(command: Command, watch: Watch | None) -> Outcome:
    """Run the job of a command that is no sweep, as `hydra.main` does."""
    config = command.config
    _check_hydra(config)
    context, callbacks = _context(config)
    callbacks.on_run_start(config=config, config_name=configs.config_name())
    outcome, returned = run_as_job(command, context, watch)
    callbacks.on_run_end(config=config, config_name=configs.config_name(), job_return=returned)
    return outcome


def _outcome_since(started: str, config: DictConfig) -> Outcome:
    """The outcome of another sweeper's jobs: what the score table has since then."""
    job = compose_jobs.job_of(config)
    rows = results.merge(job.out)
    return outcome_of(job, rows, rows[rows["time"] >= started])
