"""`sucre-bench run` as a program of Hydra: its configuration, callbacks, sweeper and launcher.

A configuration that Hydra composed is also run from Python, and by a launcher of Hydra.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from sucre_bench import results
from sucre_bench.arrays import DataFrame
from sucre_bench.engine.preflight import check
from sucre_bench.engine.run import Outcome, Watch, outcome_of, run
from sucre_bench.engine.workers import run_jobs
from sucre_bench.errors import InputError, in_one_line
from sucre_bench.jobs import hydra_configs
from sucre_bench.jobs.compose_jobs import Command, command_of, job_of, lines_of
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.read_words import read, reading_experiment
from sucre_bench.jobs.word_syntax import parse, value_of
from sucre_bench.machine import progress
from sucre_bench.machine.text_formats import now
from sucre_bench.plugins.plugin import Plugin

if TYPE_CHECKING:
    from hydra.core.utils import JobReturn
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
            return _run_single(command_of(asked), watch)
        config = asked.config
        lines = [word.line for word in asked.typed]
        swept = [*words]
        is_ours = asked.choice("hydra/sweeper") == "pairs"
        if not is_ours:  # what all jobs share is not among what tells them apart
            lines = lines_of(asked)
            config = hydra_configs.composed(lines, is_sweep=True)
            parsed = zip(lines, parse(lines, hydra_configs.loader()), strict=True)
            swept = [line for line, word in parsed if word.is_swept]
            shared = [line for line in lines if line not in swept]
            keys = [line.lstrip("+").partition("=")[0] for line in shared]
            unnamed = f"hydra.job.config.override_dirname.exclude_keys={value_of(keys)}"
            with open_dict(config):
                config.hydra.overrides.hydra = [*shared, unnamed]
                config.hydra.overrides.task = swept
                _with_direction(config, shared)
        _check_hydra(config)
        configure_log(config.hydra.hydra_logging, config.hydra.verbose)
        context = _context(config)
        context.callbacks.on_multirun_start(
            config=config, config_name=hydra_configs.config_name()
        )
        with hydra_configs.faults_of_hydra(lines):
            sweeper: Any = Plugins.instance().instantiate_sweeper(
                config=config, hydra_context=context, task_function=run_launched
            )
            started = now()
            sweeper.watch = watch
            if watch and not is_ours:
                watch.start(job_of(config))
                watch.before(())
            outcome = sweeper.sweep(arguments=swept)
        context.callbacks.on_multirun_end(
            config=config, config_name=hydra_configs.config_name()
        )
        if isinstance(outcome, Outcome):
            return outcome
        # another sweeper's jobs: what the score table has since then
        return outcome_of(job_of(config), started)


def _check_hydra(config: DictConfig) -> None:
    """Refuse another working folder, and a launcher of SLURM where no cluster answers. Raises InputError."""
    if config.hydra.job.chdir:
        fault = "paths of a command are relative to the folder where it runs"
        raise InputError(fault, "hydra.job.chdir=true", "leave it out")
    launcher = config.hydra.runtime.choices["hydra/launcher"]
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


def _context(config: DictConfig) -> HydraContext:
    from hydra._internal.callbacks import Callbacks
    from hydra.types import HydraContext

    return HydraContext(config_loader=hydra_configs.loader(), callbacks=Callbacks(config))


def _run_single(command: Command, watch: Watch | None) -> Outcome:
    """Run the job of a command that is no sweep, as `hydra.main` does."""
    config = command.config
    _check_hydra(config)
    context = _context(config)
    context.callbacks.on_run_start(config=config, config_name=hydra_configs.config_name())
    outcome, returned = run_as_job(command, context, watch)
    context.callbacks.on_run_end(
        config=config, config_name=hydra_configs.config_name(), job_return=returned
    )
    return outcome


# -- a configuration that Hydra composed -----------------------------------------------------------------------


def run_config(config: DictConfig) -> DataFrame:
    """Restore and score what a configuration of Hydra chooses, and return the rows of it.

    - config: what `hydra.compose("config", [...])` returns, with `sucre_bench.conf` as Hydra's config module.

    >>> import hydra
    >>> with hydra.initialize_config_module("sucre_bench.conf", version_base=None):
    ...     words = ["dataset=demo", "dataset.views=2", "method=gray_world", "metrics=[psnr]", "tracking.uri=off"]
    ...     config = hydra.compose("config", words)
    >>> rows = run_config(config)
    >>> rows["method"].unique().tolist()
    ['gray_world']

    The results folder is `out`, as of `sucre-bench run`; what is stored there is not computed again.

    Raises InputError for a value that does not fit, ProblemsError for data that are not as expected.
    """
    with progress.live():
        return run(Command((job_of(config),), config)).requested_rows


def run_as_job(
    command: Command, context: HydraContext, watch: Watch | None
) -> tuple[Outcome, JobReturn]:
    """Run a command as one job of Hydra, with its logging, environment and callbacks. Raises as `engine.run.run`."""
    from hydra.core.utils import JobStatus, run_job

    returned = run_job(
        task_function=lambda _: run(command, watch),
        config=command.config,
        job_dir_key="hydra.run.dir",
        job_subdir_key=None,
        hydra_context=context,
    )
    # The public property would print the fault, which the command says in one line.
    outcome = returned._return_value  # noqa: SLF001
    if returned.status != JobStatus.COMPLETED:
        raise outcome
    assert isinstance(outcome, Outcome)
    return outcome, returned


def run_launched(config: DictConfig) -> float | None:
    """Run one job of a sweep where a launcher of Hydra wants it, and return its objective, if it has one.

    Its rows are written as parts of the score table; the command that launched it merges them.
    """
    from hydra.core.hydra_config import HydraConfig

    ours = HydraConfig.get()
    keys = [word.lstrip("+").partition("=")[0] for word in ours.overrides.task]
    # Another sweeper gives a job no label: the options that it sets make one.
    shared = ours.job.config.override_dirname.exclude_keys
    is_labelled = "method.label" in keys
    swept = () if is_labelled else [key for key in keys if "." in key and key not in shared]
    job = job_of(config, swept)
    with progress.live(plain=True):
        run_jobs(check(Command((job,), config)), job.workers)
    return _objective(job) if job.objective else None


# What has a sweeper look for the largest value: its setting, by the key of its configuration.
_MAXIMISE: Mapping[str, Any] = {
    "direction": "maximize",  # optuna
    "optim.maximize": True,  # nevergrad
    "ax_config.experiment.minimize": False,
}


def _with_direction(config: DictConfig, words: Sequence[str]) -> None:
    """Have another sweeper look for the largest objective where more is better, unless words say what it looks for."""
    from omegaconf import OmegaConf, read_write

    job = job_of(config)
    if not job.objective:
        return
    metric, variant = _objective_of(job)
    if metric.better_of(variant) != "higher":
        return
    for key, value in _MAXIMISE.items():
        is_given = any(word.lstrip("+").startswith(f"hydra.sweeper.{key}=") for word in words)
        if not is_given and OmegaConf.select(config.hydra.sweeper, key) is not None:
            with read_write(config.hydra.sweeper):
                OmegaConf.update(config.hydra.sweeper, key, value)


def _objective_of(job: Job) -> tuple[Plugin, str]:
    """Return the metric and variant that a sweeper optimises. InputError if the job has no such score."""
    name, _, variant = job.objective.replace(":", ".", 1).partition(".")
    for metric in job.metrics:
        chosen = variant or metric.variants[0]
        if metric.plugin.name == name and chosen in metric.variants:
            return metric.plugin, chosen
    known = [f"{metric.plugin.name}.{one}" for metric in job.metrics for one in metric.variants]
    raise InputError(
        "is no score of this run",
        f"objective={job.objective}",
        f"give one of {', '.join(known)}, or another metrics=[...]",
    )


def _objective(job: Job) -> float:
    """The mean of the job's objective over its views, of each its mean over charts. InputError if none has a score."""
    metric, variant = _objective_of(job)
    rows: Any = results.read(job.out, dataset=job.dataset.label, method=job.method.label)
    is_score = (rows["metric"] == metric.name) & (rows["variant"] == variant)
    rows = rows[is_score & (rows["status"] == "ok")]
    whole = rows[rows["region"] == "image"]
    if whole.empty:
        whole = rows[~rows["region"].str.contains("/")]
    if whole.empty:
        raise InputError(
            "no view has a score",
            f"objective={job.objective}",
            "give a metric that these data have",
        )
    return float(whole.groupby(["scene", "view"])["value"].mean().mean())
